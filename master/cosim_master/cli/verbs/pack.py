"""The verb `pack`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim_master.cli.terminal.console import command, errors, print_json, say
from cosim_master.cli.terminal.options import Json, System, Variant
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb
from cosim_master.diagnostics.errors import counted

if TYPE_CHECKING:
    from cosim_master.system.flatten.flat import CheckedSystem


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
        found = packed(system, out, variant=variant, overwrite=force, settings=_settings())
    if as_json:
        print_json({"files": [str(found.path)], "members": list(found.members), "variants": list(found.variants)})
        return
    size = found.path.stat().st_size / 1e6
    say(f"{found.path}: {counted(len(found.members), 'file')}, {size:.1f} MB; {command('run', found.path)}")


def _settings() -> tuple[Callable[[CheckedSystem], object], ...]:
    """Returns what reads the settings that do not depend on the time of a run."""
    from cosim_master.system.settings.master import master_settings_of
    from cosim_master.system.settings.network import network_of
    from cosim_master.system.settings.recording import recording_of
    from cosim_master.verdict.monitors.declared import monitors_of
    from cosim_master.verdict.watching.limits import limits_of

    return (
        partial(recording_of, record=()),
        master_settings_of,
        partial(network_of, seed=None),
        limits_of,
        partial(monitors_of, network=None, clock=None),
    )
