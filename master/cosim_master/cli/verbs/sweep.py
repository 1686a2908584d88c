"""The verb `sweep`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim_master.cli.terminal.console import errors, note, print_json, report_error, say, usage
from cosim_master.cli.terminal.options import Json, Settings, Step, Until, Variant, changes, overrides
from cosim_master.cli.terminal.progress import Activity, activity, clock
from cosim_master.cli.terminal.registry import verb

if TYPE_CHECKING:
    from cosim_master.campaigns.campaign import Campaign, Standing
    from cosim_master.campaigns.study.study import Search, Study

_System = Annotated[
    str,
    typer.Argument(
        metavar="SYSTEM",
        help="An .ssd, .ssp, .fmu, multi-model or folder, or the name of a shipped system; or the folder of a campaign "
        "that is to go on.",
    ),
]
_Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUES",
        help="Vary a start value or a setting: 'drone*.agent.epsilon=0.1:0.6:11', network.loss=0,0.1,0.2; "
        "NAME@TIME: from a time in s on. May be repeated.",
    ),
]
_Sample = Annotated[
    str,
    typer.Option(
        metavar="DESIGN",
        help="The points: grid, lhs:N, sobol:N, morris:N (elementary effects) or indices:N (Sobol indices).",
    ),
]
_Optimise = Annotated[
    str | None,
    typer.Option(
        metavar="min|max METRIC",
        help="Search for the least or greatest value of a metric, its mean over the seeds (Optuna).",
        show_default=False,
    ),
]
_Trials = Annotated[
    int | None,
    typer.Option(metavar="N", min=1, max=10**6, help="With --optimise: points of the search.", show_default="100"),
]
_Seeds = Annotated[
    int | None,
    typer.Option(
        metavar="N", min=1, max=10**7, help="Run each point with the seeds 1 to N.", show_default="the system's seed"
    ),
]
_Metric = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]METRIC",
        help="A number for each run: built-in (settling_time, error_to_law, nearest_approach, packets_lost, energy), "
        "an expression over signals, or FILE.py:FUNCTION. May be repeated.",
        show_default="nearest_approach, packets_lost",
    ),
]
_Keep = Annotated[
    list[str] | None,
    typer.Option(metavar="PATTERN", help="Keep the signals that match of every run; may be repeated."),
]
_At = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TIME COMPONENT.PARAMETER=VALUE", help="Set a value at a time in s in all runs; may be repeated."
    ),
]
_Solver = Annotated[
    str | None,
    typer.Option(metavar="NAME[:NUMBER]", help="Integrates FMUs for Model Exchange, as in `run`.", show_default=False),
]
_Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--out",
        metavar="FOLDER",
        help="Folder for the dataset; a campaign of the same study in it goes on.",
        show_default="out/NAME-sweep",
    ),
]
_Force = Annotated[
    bool, typer.Option("--force", help="Remove a campaign of another study from the folder.", show_default=False)
]
_Workers = Annotated[
    int | None,
    typer.Option(metavar="N", min=1, max=4096, help="Processes on this machine.", show_default="one for each core"),
]
_Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="A Dask scheduler whose workers make the runs, or its scheduler file.",
        show_default="a cluster of this machine",
    ),
]


@verb(
    "sweep line5 --vary 'drone*.agent.epsilon=0.1:0.6:11' --vary network.loss=0,0.1,0.2 --seeds 100 "
    "--metric settling_time --until 60 -o out/study",
    "sweep line5 --vary 'drone*.agent.epsilon=0.1:0.6' --sample lhs:200 --metric error_to_law",
    "sweep out/study",
)
def sweep(
    system: _System,
    vary: _Vary = None,
    sample: _Sample = "grid",
    optimise: _Optimise = None,
    trials: _Trials = None,
    seeds: _Seeds = None,
    metric: _Metric = None,
    keep: _Keep = None,
    folder: _Out = None,
    force: _Force = False,
    variant: Variant = None,
    until: Until = None,
    step: Step = None,
    settings: Settings = None,
    at: _At = None,
    solver: _Solver = None,
    workers: _Workers = None,
    scheduler: _Scheduler = None,
    as_json: Json = False,
) -> None:
    """Make many runs of a system, with varied values and seeds, on all cores or on a cluster."""
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        import distributed  # noqa: F401 (if it is missing, nothing is written)

        from cosim_master.campaigns.campaign import sweep as made
        from cosim_master.campaigns.dataset.folder import is_campaign, read_study

        if is_campaign(Path(system)):
            study_too = vary, metric, keep, settings, at, seeds, folder, optimise, trials, until, step, variant, solver
            if sample != "grid" or any(study_too):  # numbers are positive
                raise usage(f"{system} holds a campaign, which goes on as it began; leave out all options of the study")
            study, folder = read_study(Path(system))[0], Path(system)
        else:
            study = _study(system, vary, sample, seeds, metric, keep, _search(optimise, trials))
            common = {"overrides": overrides(settings), "at": tuple(changes(at))}
            study = _with(study, **common, until=until, step=step, variant=variant, solver=solver)
            folder = folder or Path("out") / f"{Path(system).resolve().stem}-sweep"
        doing.stage(f"checking {study.system}")
        campaign = made(
            study, folder, workers=workers, scheduler=scheduler, force=force,
            started=lambda cluster: _started(doing, cluster.dashboard, as_json=as_json),
            progress=lambda standing: _show(doing, standing),
        )  # fmt: skip
    if as_json:
        print_json(_document(campaign))
    else:
        _report(campaign)
    if campaign.interrupted:
        raise typer.Exit(130)
    if campaign.bad:
        raise typer.Exit(1)


def _study(
    system: str,
    vary: list[str] | None,
    sample: str,
    seeds: int | None,
    metric: list[str] | None,
    keep: list[str] | None,
    search: Search | None,
) -> Study:
    from cosim_master.campaigns.metrics.metric import Metric
    from cosim_master.campaigns.study.designs import Design
    from cosim_master.campaigns.study.factors import Factor
    from cosim_master.campaigns.study.study import Study

    return Study(
        system=str(Path(system).resolve()) if Path(system).exists() else system,
        factors=tuple(Factor.parsed(text) for text in vary or ()),
        design=Design.parsed(sample),
        seeds=tuple(range(1, (seeds or 0) + 1)),
        metrics=tuple(Metric.parsed(text) for text in metric or ("nearest_approach", "packets_lost")),
        keep=tuple(keep or ()),
        search=search,
    )


def _search(optimise: str | None, trials: int | None) -> Search | None:
    if optimise is None:
        if trials is not None:
            raise usage("--trials belongs to --optimise, which is not given; a design has its size in --sample")
        return None
    import optuna  # noqa: F401 (if it is missing, nothing is written)

    from cosim_master.campaigns.study.study import Search

    return Search.parsed(optimise, 100 if trials is None else trials)


def _with(study: Study, **given: Any) -> Study:
    from dataclasses import replace

    return replace(study, **given)


def _started(doing: Activity, dashboard: str, *, as_json: bool) -> None:
    doing.end()
    if dashboard and not as_json:
        note(f"dashboard: {dashboard}")


def _show(doing: Activity, standing: Standing) -> None:
    done = standing.before + standing.made
    left = "-:--" if standing.left is None else clock(standing.left)
    bad = f"  {standing.bad} failed" if standing.bad else ""
    words = f"{done}/{standing.runs} runs  {standing.rate:.1f} runs/s  {left} left  {standing.workers} workers{bad}"
    doing.share(done, standing.runs, words)


def _report(campaign: Campaign) -> None:
    rate = campaign.made / campaign.wall_s if campaign.wall_s > 0.0 else 0.0
    counts = ", ".join(f"{n} {outcome}" for outcome, n in sorted(campaign.outcomes.items())) or "none"
    before = f", {campaign.before} before" if campaign.before else ""
    say(
        f"{campaign.before + campaign.made} of {campaign.runs} runs ({counts}): {campaign.made} in "
        f"{campaign.wall_s:.1f} s ({rate:.1f} runs/s){before}"
    )
    if campaign.shared:
        say(f"beginnings that several runs share: {campaign.shared}, each simulated once")
    say(f"results: {campaign.folder}")
    if campaign.bad:
        report_error(_failed(campaign))
    else:
        for text in _without_values(campaign):
            note(text)
    if campaign.interrupted:
        note(f"interrupted; `uav-cosim sweep {campaign.folder}` goes on")


def _without_values(campaign: Campaign) -> Iterator[str]:
    """Yields notes on metrics that have a value in none of the runs, which all ended well, with the first reason."""
    table = campaign.table()
    for name in table.column_names[table.column_names.index("simulated_s") + 1 :]:  # the metrics
        if table.num_rows and table[name].null_count == table.num_rows:
            head, lines = f"metric {name}: ", str(table["reason"][0]).splitlines()
            own = [line.removeprefix(head) for line in lines if line.startswith(head)] or lines
            yield f"no run has a value of metric {name}; run {table['run'][0]}: {' '.join(own)}"


def _failed(campaign: Campaign) -> str:
    """Returns how many runs failed, and why the first of them did."""
    from cosim_master.campaigns.running.task import BAD

    rows = campaign.table().select(["run", "outcome", "reason"]).to_pylist()
    first = next(row for row in rows if row["outcome"] in BAD)
    return (
        f"{campaign.bad} of {campaign.runs} runs failed; run {first['run']}: {first['reason']}"
        f"{'; the column `reason` has all reasons' if campaign.bad > 1 else ''}"
    )


def _document(campaign: Campaign) -> dict[str, Any]:
    return {
        "folder": str(campaign.folder),
        "runs": campaign.runs,
        "before": campaign.before,
        "made": campaign.made,
        "outcomes": dict(campaign.outcomes),
        "complete": campaign.complete,
        "interrupted": campaign.interrupted,
        "shared": campaign.shared,
        "wall_s": campaign.wall_s,
    }
