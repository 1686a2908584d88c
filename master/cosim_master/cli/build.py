"""Verbs that make what a system consists of: `build`, `dialect`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim_master.cli.console import app, err, out, usage


@app.command()
def build(
    models: Annotated[
        list[str] | None,
        typer.Argument(help="Model names (Quadrotor), modules or .py files; default: every model of cosim_models."),
    ] = None,
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the FMUs.")] = Path("fmus"),
    interpreted: Annotated[
        bool, typer.Option("--interpreted", help="Pack the Python sources (pythonfmu) instead of compiling them.")
    ] = False,
    target: Annotated[
        list[str] | None, typer.Option(help="Platform to build for; may be repeated. Default: this one.")
    ] = None,
    fmi: Annotated[int, typer.Option(help="2 writes NAME.fmu, 3 writes NAME.fmi3.fmu; both may be in one system.")] = 2,
) -> None:
    """Build FMUs from models, only those that changed."""
    from cosim.build import HOST, CannotCompile, build_all, load_models, models_of_package

    try:
        chosen = []
        for name in models or [model.__name__ for model in models_of_package("cosim_models")]:
            if "." in name:
                chosen += load_models(name)
                continue
            known = models_of_package("cosim_models")
            matching = [model for model in known if model.__name__ == name]
            if not matching:
                names = ", ".join(model.__name__ for model in known)
                raise ValueError(f"no model called {name}: there are {names}; or give a module or a .py file")
            chosen += matching
        for built in build_all(chosen, folder, interpreted=interpreted, targets=target or [HOST], fmi=fmi):
            state = "up to date" if built.fresh else "compiled" if built.compiled else "interpreted"
            out.print(f"{built.file}: {state}", markup=False)
            if built.note:
                out.print(f"  {built.note}", markup=False)
    except (ValueError, ImportError, SyntaxError, CannotCompile) as error:
        raise usage(str(error)) from None
    except RuntimeError as error:
        err.print(f"error: {error}", markup=False)
        raise typer.Exit(1) from None


@app.command()
def dialect(
    xml: Annotated[Path, typer.Argument(help="A MAVLink XML file with messages of your own.")],
    module: Annotated[Path, typer.Option("-o", "--out", help="Python module to write.")],
) -> None:
    """Write a module with which models read and send messages of your own."""
    from cosim.build.dialects import module_source, read_xml

    try:
        messages = read_xml(xml)
        module.write_text(module_source(messages, xml.name), encoding="utf-8")
    except ValueError as error:
        raise usage(str(error)) from None
    except OSError as error:
        raise usage(f"{error.filename}: {error.strerror}") from None
    out.print(f"{module}: {', '.join(messages) or 'no messages that ardupilotmega does not have'}", markup=False)
