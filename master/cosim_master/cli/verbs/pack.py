"""The verb `pack`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim_master.cli.terminal.console import command, errors, print_json, say
from cosim_master.cli.terminal.options import Json, System, Variant
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb
from cosim_master.diagnostics.errors import counted


@verb("pack line5 -o line5.ssp")
def pack(
    system: System,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="The .ssp to write.")],
    variant: Variant = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite the file if it exists.", show_default=False)
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a system and all that it refers to as one .ssp, which runs anywhere."""
    from cosim_master.system.authoring.pack import pack as packed

    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"packing {system}")
        found = packed(system, out, variant=variant, overwrite=force)
    if as_json:
        print_json({"files": [str(found.path)], "members": list(found.members), "variants": list(found.variants)})
        return
    size = found.path.stat().st_size / 1e6
    say(f"{found.path}: {counted(len(found.members), 'file')}, {size:.1f} MB; {command('run', found.path)}")
