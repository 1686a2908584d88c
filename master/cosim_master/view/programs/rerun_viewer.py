"""Serves a .rrd file and Rerun's page, which shows it, on loopback. The page reaches no other machine.

    with RerunViewer(file) as viewer:       the page is at viewer.address
        viewer.wait()                       until Rerun's program ends

Rerun's program contains the page and can serve it. Its page reports on its use, looks for newer versions, and loads
fonts and examples; the program's own configuration does not change that. Therefore the page is served here, with a
content security policy that permits requests to this server only. The address contains a random token; without it,
every request is answered by 404. The program itself runs with a configuration that switches its reports off.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, BinaryIO, Self
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import ProxyHandler, build_opener

from cosim_master.diagnostics.errors import CosimError

__all__ = ["RerunViewer"]

_HOST = "127.0.0.1"
_SERVED = re.compile(r"Hosting a web-viewer at (http://127\.0\.0\.1:\d+)")
_ELSEWHERE = re.compile(rb"<link\b[^>]*https://[^>]*>")
_PARTS = {"": "text/html; charset=utf-8", "re_viewer.js": "text/javascript", "re_viewer_bg.wasm": "application/wasm"}
"""The parts of Rerun's page, and their types."""
_POLICY = (
    "default-src 'none'; connect-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
_GRACE = 10.0
"""Wall-clock time in which the program ends when it is told to, s."""


class RerunViewer:
    """Rerun's page with one recording.

    Args:
        file: the .rrd file.

    Attributes:
        address: the address of the page, with its token.

    Raises:
        CosimError: Rerun's program cannot be started or serves no page, or no port of loopback can be opened.
        ModuleNotFoundError: Rerun is not installed.
    """

    def __init__(self, file: Path) -> None:
        import rerun_cli

        program = Path(rerun_cli.__file__).with_name("rerun")
        with ExitStack() as opened:
            try:
                server = opened.enter_context(_Server(file))
                self._process = opened.enter_context(_running(program, server.recording))
            except (OSError, subprocess.CalledProcessError) as error:
                raise CosimError(f"{program}: the Rerun viewer cannot be started: {error}") from error
            server.source = self._source()
            thread = threading.Thread(target=server.serve_forever, name="Rerun viewer", daemon=True)
            thread.start()
            opened.callback(thread.join)
            opened.callback(server.shutdown)
            self.address = server.page
            self._opened = opened.pop_all()

    def _source(self) -> str:
        """Returns the address at which the program serves its page, when it does."""
        said: list[str] = []
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if found := _SERVED.search(line):
                return found[1]
            said.append(line.strip())
        raise CosimError(f"the Rerun viewer ended before it served a page: {' '.join(said[-3:])}")

    def wait(self) -> None:
        """Waits until the program ends, and meanwhile takes all that it prints."""
        assert self._process.stdout is not None
        for _ in self._process.stdout:
            pass

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.close()


@contextmanager
def _running(program: Path, recording: str) -> Iterator[subprocess.Popen[str]]:
    """Starts the program; it serves its page only, since the recording has an address."""
    with TemporaryDirectory(prefix="uav-cosim-rerun-") as folder:
        own = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_DATA_HOME"), folder)
        environment = {**os.environ, **own, "NO_COLOR": "1"}
        subprocess.run([program, "analytics", "disable"], env=environment, check=True, capture_output=True, text=True)
        process = subprocess.Popen(
            [program, "--serve-web", "--bind", _HOST, "--web-viewer-port", "0", recording],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        with process:
            try:
                yield process
            finally:
                process.terminate()
                try:
                    process.wait(_GRACE)
                except subprocess.TimeoutExpired:
                    process.kill()


class _Server(ThreadingHTTPServer):
    """Serves the page and the recording.

    Attributes:
        page, recording: their addresses.
        source: the address at which the program serves its page.
        parts: paths of requests, and the parts of the page or the recording's file.
    """

    daemon_threads = True

    def __init__(self, file: Path) -> None:
        super().__init__((_HOST, 0), _Handler)
        self.host = f"{_HOST}:{self.server_port}"
        place, name = f"/{secrets.token_urlsafe(24)}/", quote(file.name)
        self.recording = f"http://{self.host}{place}{name}"
        self.page = f"http://{self.host}{place}?url={quote(self.recording, safe='')}&persist=false"
        self.source = ""
        self.parts: dict[str, str | Path] = {place + part: part for part in _PARTS}
        self.parts[place + name] = file


class _Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    def do_GET(self) -> None:
        server: Any = self.server
        part = server.parts.get(self.path.partition("?")[0])
        if self.headers.get_all("Host") != [server.host]:
            self.send_error(HTTPStatus.FORBIDDEN)
        elif part is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif isinstance(part, Path):
            with part.open("rb") as file:
                self._send("application/octet-stream", file)
        else:
            self._pass_on(f"{server.source}/{part}", _PARTS[part])

    def _pass_on(self, source: str, kind: str) -> None:
        try:
            with build_opener(ProxyHandler({})).open(source) as answer:
                self._send(kind, answer)
        except URLError as error:
            self.send_error(HTTPStatus.BAD_GATEWAY, str(error.reason))

    def _send(self, kind: str, source: BinaryIO) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        if kind.startswith("text/html"):
            self.wfile.write(_ELSEWHERE.sub(b"", source.read()))  # no policy keeps a browser from connecting ahead
        else:
            shutil.copyfileobj(source, self.wfile)

    def log_message(self, format: str, *args: Any) -> None:
        """Prints nothing."""
