"""The verb `serve`."""

from __future__ import annotations

import os
import secrets
import signal
import threading
from types import FrameType
from typing import Annotated

import typer

from cosim_master.cli.terminal.console import announce, errors, note, out, print_json, usage
from cosim_master.cli.terminal.options import Json
from cosim_master.cli.terminal.registry import verb


@verb("serve", "serve --bind 0.0.0.0 --port 5600")
def serve(
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="The port; 0: a free one.")] = 5600,
    bind: Annotated[
        str, typer.Option(metavar="ADDRESS", help="The address to listen at; 0.0.0.0: all of this machine.")
    ] = "127.0.0.1",
    memory_limit: Annotated[
        int | None,
        typer.Option(metavar="MIB", min=16, help="Memory of each FMU's process.", show_default="half of the machine's"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Run FMUs of systems on other machines (`run --host`), for everyone who knows the token in UAV_COSIM_TOKEN."""
    with errors(as_json=as_json):
        from cosim_master.fmi.isolation.building import CannotIsolate
        from cosim_master.fmi.isolation.child import TOKEN, Limits
        from cosim_master.fmi.serving import Server

        token = os.environ.pop(TOKEN, "")  # FMUs do not see it
        if given := token:
            if len(given) < 16:
                raise usage(
                    f"the token in {TOKEN} has {len(given)} characters; give at least 16, or none for a new one"
                )
        else:
            token = secrets.token_urlsafe(24)
        limits = Limits() if memory_limit is None else Limits(memory=memory_limit << 20)
        try:
            server = Server(bind, port, token, limits, note)
        except CannotIsolate as error:
            raise usage(str(error)) from None
        except OSError as error:
            raise usage(f"{bind}:{port} cannot be used: {error.strerror or error}; try another --port") from None
        ended = threading.Event()

        def end(_number: int, _frame: FrameType | None) -> None:
            ended.set()

        before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            with server:
                threading.Thread(target=server.serve, daemon=True).start()
                if as_json:
                    print_json({"bind": bind, "port": server.port, "token": token})
                    out.file.flush()
                elif not given:
                    announce(f"export {TOKEN}={token}")
                announce(f"FMUs run here for masters at {bind}:{server.port}; Ctrl-C ends this")
                ended.wait()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
