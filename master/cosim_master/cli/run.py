"""The verb `run`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim_master.cli.console import (
    Settings,
    Step,
    System,
    Until,
    Variant,
    app,
    changes,
    err,
    errors,
    note,
    out,
    overrides,
    print_notes,
    print_tables,
    usage,
)

if TYPE_CHECKING:
    from cosim_master.simulation import Progress, RunResult


@app.command()
def run(
    system: System,
    folder: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for the results.")] = None,
    variant: Variant = None,
    until: Until = None,
    step: Step = None,
    pace: Annotated[float | None, typer.Option(help="Hold at most this many times real time.")] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**53, help="Seed of the radio; default: the system's.")
    ] = None,
    settings: Settings = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIME COMPONENT.PARAMETER=VALUE",
            help="Set a tunable parameter or an open input at a time in s; may be repeated.",
        ),
    ] = None,
    record: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Signals to record, e.g. '*.position*'; default: all outputs."),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="Threads that step native FMUs; default: all cores for large systems.")
    ] = None,
    gcs: Annotated[
        list[str] | None,
        typer.Option(metavar="ADDRESS", help="A ground station, e.g. udpout:127.0.0.1:14550; may be repeated."),
    ] = None,
    ports: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Serial ports of the autopilots, e.g. tcp:5760+10 for 5760, 5770, ..."),
    ] = None,
    profile: Annotated[bool, typer.Option("--profile", help="Tell where the time went, by FMU and phase.")] = False,
    checkpoint_every: Annotated[
        float | None, typer.Option(metavar="S", help="Write a checkpoint every so many simulated seconds.")
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option("--from", metavar="RUN@TIME", help="Go on from a checkpoint; --set then changes values there."),
    ] = None,
) -> None:
    """Run a system."""
    from cosim_master.calls import PLAIN
    from cosim_master.simulation import simulate

    if profile and PLAIN:
        raise usage("--profile needs compiled kernels; NUMBA_DISABLE_JIT is set")
    if threads is not None and threads < 1:
        raise usage(f"--threads {threads}: give a positive number")
    if pace is not None and not 0 < pace < math.inf:
        raise usage(f"--pace {pace:g}: give a positive factor of real time")
    folder = folder or Path("out") / Path(system).resolve().stem
    with errors(), _progress() as show:
        result = simulate(
            system,
            variant=variant,
            out=folder,
            until=until,
            step=step,
            pace=pace,
            seed=seed,
            overrides=overrides(settings),
            record=record or (),
            at=changes(at),
            threads=threads,
            profile=profile,
            on_start=print_notes,
            on_progress=show,
            gcs=gcs or (),
            ports=ports,
            on_gateway=note,
            checkpoint_every=checkpoint_every,
            origin=origin,
        )
    _report(result, folder)


@contextmanager
def _progress() -> Iterator[Callable[[Progress], None]]:
    """A bar with simulated time, speed and time left; nothing where the output is no terminal."""
    from rich import progress as rich

    columns = (
        rich.BarColumn(),
        rich.TextColumn("{task.completed:.1f}/{task.total:.1f} s"),
        rich.TextColumn("{task.fields[speed]:.1f} x real time"),
        rich.TimeRemainingColumn(),
    )
    with rich.Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task("run", total=0.0, speed=0.0)

        def show(progress: Progress) -> None:
            done = progress.time - progress.start
            speed = done / progress.wall if progress.wall else 0.0
            bar.update(task, total=progress.stop - progress.start, completed=done, speed=speed)

        yield show


def _report(result: RunResult, folder: Path) -> None:
    if result.error is not None:
        word = "note" if result.outcome == "terminated" else "error"
        err.print(f"{word}: {result.error}", markup=False)
    packets = result.packets
    if result.outcome != "failed" or packets:
        counts = ", ".join(f"{packets.get(name, 0)} {name}" for name in ("sent", "delivered", "lost"))
        out.print(
            f"{result.outcome}: {result.simulated_s:g} s simulated in {result.wall_s:.2f} s "
            f"({result.real_time_factor:.1f} times real time), packets {counts}; {folder}",
            markup=False,
        )
    for gateway, crossed in result.gateways.items():
        text = ", ".join(f"{n} {what}" for what, n in crossed.items() if what != "address")
        note(f"{gateway} ({crossed['address']}): {text or 'nothing has crossed'}")
    if result.profile is not None:
        from cosim_master.inspection import profile_tables

        print_tables(profile_tables(result.profile))
    if result.overruns[0]:
        err.print(f"note: the pace was missed {result.overruns[0]} times, by {result.overruns[1]:.3f} s at worst")
    if result.outcome == "failed":
        raise typer.Exit(1)
    if result.outcome == "interrupted":
        raise typer.Exit(130)
