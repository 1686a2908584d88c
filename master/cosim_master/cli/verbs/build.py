"""Verbs that make parts of a system: `build`, `dialect`."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim_master.cli.terminal.console import errors, note, print_json, report_error, say, usage
from cosim_master.cli.terminal.options import Json
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb
from cosim_master.diagnostics.names import near, similar
from cosim_master.files.whole import is_special, named, write_whole, writing
from cosim_master.system import shipped

if TYPE_CHECKING:
    from cosim import Model


_Models = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="MODEL",
        help="Model names (Quadrotor), names of shipped systems (line5), modules or .py files.",
        show_default="every model of cosim_models",
    ),
]
_Out = Annotated[Path, typer.Option("-o", "--out", metavar="FOLDER", help="Folder for the FMUs.")]
_Interpreted = Annotated[
    bool,
    typer.Option(
        "--interpreted", help="Pack the Python sources (pythonfmu) instead of compiling them.", show_default=False
    ),
]
_Target = Annotated[
    list[str] | None,
    typer.Option(metavar="PLATFORM", help="Platform to build for; may be repeated.", show_default="the one it runs on"),
]
_Fmi = Annotated[
    int, typer.Option(metavar="2|3", help="2 writes NAME.fmu, 3 writes NAME.fmi3.fmu; a system may have both.")
]
_Checked = Annotated[
    bool | None,
    typer.Option(
        "--checked/--unchecked",
        help="Whether steps fail where an index lies outside its array or a loop does not end.",
        show_default="checked; the models of cosim_models: unchecked",
    ),
]


@verb("build", "build line5", "build integrator.py -o fmus", "build Quadrotor --fmi 3 --target windows-x86_64")
def build(
    models: _Models = None,
    folder: _Out = Path("fmus"),
    interpreted: _Interpreted = False,
    target: _Target = None,
    fmi: _Fmi = 2,
    checked: _Checked = None,
    as_json: Json = False,
) -> None:
    """Build FMUs from models, only those that changed."""
    with activity() as doing:
        doing.starting()
        from cosim.build import HOST, CannotCompile, build_all

    made: list[dict[str, Any]] = []
    try:
        chosen = _chosen(models)
        if fmi == 3 and not models:
            for model in [model for model in chosen if model.kernels is None]:
                chosen.remove(model)
                made.append(_not_built(model, as_json=as_json))
        with activity() as doing, _loop_compiled(models, doing.stage):
            building = build_all(
                chosen,
                folder,
                interpreted=interpreted,
                targets=target or [HOST],
                fmi=fmi,
                checked=checked,
                on_building=lambda names: doing.stage(f"building {', '.join(names)}"),
            )
            for model, built in zip(chosen, building, strict=True):
                state = "up to date" if built.fresh else "compiled" if built.compiled else "interpreted"
                doubts = "\n".join(built.doubts) or None
                made.append({"file": str(built.file), "model": model.__name__, "state": state, "note": doubts})
                if not as_json:
                    with doing.interrupted():
                        say(f"{built.file}: {state}")
                        for text in built.doubts:
                            note(text)
    except (ValueError, ImportError, SyntaxError, CannotCompile) as error:
        raise usage(str(error)) from None
    except RuntimeError as error:
        report_error(str(error))
        raise typer.Exit(1) from None
    if as_json:
        print_json({"fmus": made})


def _chosen(models: list[str] | None) -> list[type[Model]]:
    """Returns the models with these names, of systems, modules or files; without any, all models of cosim_models."""
    from cosim.build import load_models, models_of_package

    if not models:
        return [*models_of_package("cosim_models")]
    # Not for a file or module alone: importing all models takes as long as building one of them.
    known = [] if all("." in name for name in models) else models_of_package("cosim_models")
    chosen: dict[type[Model], None] = {}
    for name in dict.fromkeys(models):
        wanted = shipped.models(name) if name in shipped.names() else (name,)
        found = load_models(name) if "." in name else [model for model in known if model.__name__ in wanted]
        if not found and "." not in name:
            names = [model.__name__ for model in known]
            close = similar(name, [*names, *shipped.names()])
            hint = near(name, close) if close else f"there are {', '.join(names)}."
            raise ValueError(f"no model called {name}: {hint} Valid are also shipped systems, modules and .py files")
        chosen |= dict.fromkeys(found)
    return [*chosen]


def _not_built(model: type[Model], *, as_json: bool) -> dict[str, Any]:
    note = "not built: it has no kernels, and interpreted FMUs are FMI 2 only"
    if not as_json:
        say(f"{model.__name__}: {note}")
    return {"file": None, "model": model.__name__, "state": "not built", "note": note}


@contextmanager
def _loop_compiled(models: list[str] | None, tell: Callable[[str], None]) -> Iterator[None]:
    """Compiles the stepping loop, which the first run needs, in a separate process while FMUs of systems are built."""
    from cosim.kernel import has_code
    from cosim.pages import variables

    loop = Path(__file__).parents[2] / "stepping" / "kernels" / "macro_step.py"
    only_models = models and not any(name in shipped.names() for name in models)
    if only_models or os.environ.get("NUMBA_DISABLE_JIT") or has_code(loop, "run"):
        yield
        return
    code = "from cosim_master.stepping.warming import EVERY_RUN, compile_loop; compile_loop(EVERY_RUN)"
    # The process has its own session, so that Ctrl-C reaches only this process, which then ends the other.
    environment = {**os.environ, **variables()}
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.DEVNULL, start_new_session=True, env=environment
    )
    try:
        yield
        if process.poll() is None:
            tell("compiling the stepping loop, once")
            process.wait()
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()


@verb("dialect swarm.xml -o swarm_messages.py")
def dialect(
    xml: Annotated[Path, typer.Argument(metavar="XML", help="A MAVLink XML file with messages of your own.")],
    module: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="Python module to write.")],
    as_json: Json = False,
) -> None:
    """Write a module with which models read and send messages of your own."""
    from cosim.build.dialects import module_source, read_xml

    with errors(as_json=as_json):
        if module.suffix != ".py" and not is_special(module):
            raise usage(f"-o {module}: it is a Python module; name it {named(module, '.py')}")
        try:
            messages = read_xml(xml)
        except ValueError as error:
            raise usage(str(error)) from None
        except OSError as error:
            raise usage(f"{xml}: {error.strerror}") from None
        with writing(module):
            write_whole(module, module_source(messages, xml.name).encode())
        if as_json:
            print_json({"files": [str(module)], "messages": list(messages)})
        else:
            say(f"{module}: {', '.join(messages) or 'no messages that ardupilotmega does not have'}")
