"""Verbs over what there is to look at: `info`, `plot`, `export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim_master.cli.console import Variant, app, err, errors, out, print_tables


@app.command()
def info(
    path: Annotated[str, typer.Argument(help="An FMU, a system, or the results of a run.")], variant: Variant = None
) -> None:
    """Show what an FMU, a system or a run consists of."""
    from cosim_master import inspection

    with errors():
        target = Path(path)
        if target.suffix == ".fmu":
            print_tables(inspection.fmu_tables(target))
        elif (target / "manifest.json").is_file():
            print_tables(inspection.run_tables(target))
        else:
            print_tables(inspection.system_tables(path, variant))


@app.command()
def plot(
    run: Annotated[Path, typer.Argument(help="Folder of a run's results.")],
    folder: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder for the figures; default: the run's.")
    ] = None,
) -> None:
    """Draw the figures of a run."""
    from cosim_master.figures import figures

    with errors():
        for file in figures(run, folder):
            out.print(str(file), markup=False)


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="Folder of a run's results.")],
    csv: Annotated[Path, typer.Option("--csv", help="CSV file to write, as FMPy writes its results.")],
) -> None:
    """Write the signals of a run in another format."""
    from cosim_master.export import export_csv

    with errors():
        for name in export_csv(run, csv):
            err.print(f"note: {name} is text, which this format has no place for: left out", markup=False)
        out.print(str(csv), markup=False)
