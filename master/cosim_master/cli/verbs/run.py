"""The verb `run`."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import urlsplit

import typer

from cosim_master.cli.terminal.console import errors, note, notes, print_json, print_tables, report_error, say, usage
from cosim_master.cli.terminal.launching import hear_end, leave, left, part_of, serve_part
from cosim_master.cli.terminal.live import Live, Onlooker, served, shown_live
from cosim_master.cli.terminal.options import (
    Json,
    PartitionFile,
    Partitions,
    Settings,
    Step,
    Strict,
    System,
    Until,
    Variant,
    changes,
    overrides,
    positive,
)
from cosim_master.cli.terminal.progress import Activity, activity, compiling
from cosim_master.cli.terminal.registry import verb
from cosim_master.cli.terminal.verdict import show_findings, summary

if TYPE_CHECKING:
    from cosim_master.execution.options import RunOptions
    from cosim_master.execution.outcome.result import RunResult
    from cosim_master.execution.partitions.transport import Transport
    from cosim_master.execution.preparation.prepare import Prepared
    from cosim_master.network.gateways.mailbox import Mailbox


_Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--out",
        metavar="FOLDER",
        help="Folder for the results; one that holds a run of other inputs is refused.",
        show_default="out/NAME, or out/NAME-2, ... if that holds a run of other inputs",
    ),
]
_Force = Annotated[bool, typer.Option("--force", help="Overwrite what the folder holds.", show_default=False)]
_Pace = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR",
        help="Hold at most this many times real time.",
        show_default="as fast as it can",
        callback=positive("--pace", "a factor of real time"),
    ),
]
_Seed = Annotated[
    int | None, typer.Option(metavar="N", min=0, max=2**53, help="Seed of the radio.", show_default="the system's")
]
_At = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TIME COMPONENT.PARAMETER=VALUE",
        help="Set a tunable parameter or an open input at a time in s; may be repeated.",
    ),
]
_Replay = Annotated[
    Path | None,
    typer.Option(
        metavar="RUN",
        help="Repeat what was done to that run: values set, and packets sent from the live page or ROS.",
        show_default=False,
    ),
]
_Inputs = Annotated[
    Path | None,
    typer.Option("--input", metavar="FILE.csv", help="Values of open inputs over time, as FMPy reads them."),
]
_Solver = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[:NUMBER]",
        help="Integrates FMUs for Model Exchange: cvode[:TOLERANCE], euler[:STEP] or rk4[:STEP].",
        show_default="the system's, or cvode",
    ),
]
_Record = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATTERN",
        help="Signals to record, e.g. '*.position*'; may be repeated.",
        show_default="the system's, or all outputs",
    ),
]
_DataFlash = Annotated[
    bool,
    typer.Option(
        "--dataflash",
        help="Record all outputs and local variables, unless --record is given, and write ArduPilot's log of each "
        "autopilot to FOLDER/dataflash.",
        show_default=False,
    ),
]
_Threads = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="Threads that step native FMUs.", show_default="all cores for large systems, else 1"
    ),
]
_Gcs = Annotated[
    list[str] | None,
    typer.Option(metavar="ADDRESS", help="A ground station, e.g. udpout:127.0.0.1:14550; may be repeated."),
]
_Ports = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Serial ports of the autopilots, e.g. tcp:5760+10 for 5760, 5770, ..."),
]
_Isolate = Annotated[
    str | None,
    typer.Option(
        metavar="none|foreign|instance|all",
        help="FMUs in processes of their own: foreign ones (not built by this project; one process per file, or per "
        "instance), or all.",
        show_default="foreign",
    ),
]
_StepTimeout = Annotated[
    float | None,
    typer.Option(
        metavar="S", min=0, help="Wall-clock time for a call of an isolated FMU; 0: no limit.", show_default="10"
    ),
]
_MemoryLimit = Annotated[
    int | None,
    typer.Option(metavar="MIB", min=16, help="Memory of each isolated process.", show_default="half of the machine's"),
]
_RestartCrashed = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="Start a crashed process of FMUs anew, from the last state kept, up to N times.",
        show_default="the system's, or the run fails",
    ),
]
_Host = Annotated[
    list[str] | None,
    typer.Option(
        metavar="INSTANCE=MACHINE:PORT",
        help="Run an FMU on another machine, by name or pattern ('drone*.vehicle=10.0.0.7:5600'), where `uav-cosim "
        "serve` runs; UAV_COSIM_TOKEN holds its token. May be repeated.",
    ),
]
_Profile = Annotated[
    bool, typer.Option("--profile", help="Tell where the time went, by FMU and phase.", show_default=False)
]
_CheckpointEvery = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        help="Write a checkpoint every so many simulated seconds.",
        show_default="none",
        callback=positive("--checkpoint-every", "an interval in simulated s"),
    ),
]
_From = Annotated[
    str | None,
    typer.Option("--from", metavar="RUN@TIME", help="Go on from a checkpoint; --set then changes values there."),
]


_View = Annotated[
    bool,
    typer.Option(
        "--view",
        help="Show the run in a browser while it goes on, in real time unless --pace is given.",
        show_default=False,
    ),
]
_FoxglovePort = Annotated[
    int | None,
    typer.Option(
        "--foxglove",
        metavar="PORT",
        min=0,
        max=65535,
        help="Serve the run to Foxglove on this port of loopback (0: any), in real time unless --pace is given.",
        show_default=False,
    ),
]
_Ros2Domain = Annotated[
    int | None,
    typer.Option(
        "--ros2",
        metavar="DOMAIN",
        min=0,
        max=232,
        help="Publish the vehicles to this domain of ROS 2, and take set-points, in real time unless --pace is given.",
        show_default=False,
    ),
]
_Ros1Master = Annotated[
    str | None,
    typer.Option(
        "--ros1",
        metavar="URI",
        help="Publish the vehicles to the ROS 1 of this master (http://127.0.0.1:11311), and take set-points, in real "
        "time unless --pace is given.",
        show_default=False,
    ),
]
_Helics = Annotated[
    str | None,
    typer.Option(
        metavar="KIND:[HOST:]PORT",
        help="Take part in the HELICS federation of this broker (zmq, zmq_ss, tcp, tcp_ss), with nodes as endpoints. "
        "Options follow: ,to=ENDPOINT (* is every other node), ,period=S, ,name=FEDERATE.",
        show_default=False,
    ),
]
_HelicsPublish = Annotated[
    list[str] | None,
    typer.Option(metavar="OUTPUT", help="With --helics: publish an output, by name or pattern. May be repeated."),
]
_HelicsSubscribe = Annotated[
    list[str] | None,
    typer.Option(
        metavar="VARIABLE=KEY",
        help="With --helics: set an input or tunable parameter to the values of a publication. May be repeated.",
    ),
]
_NoOpen = Annotated[
    bool,
    typer.Option("--no-open", help="With --view: print the address only; do not open a browser.", show_default=False),
]


_PartitionTimeout = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        show_default="60",
        help="With --partitions: wall-clock time without a message of a part after which the run ends.",
        callback=positive("--partition-timeout", "a time in s"),
    ),
]


@verb(
    "run line5 -o out/line5",
    "run line5 --set drone3.agent.epsilon=0.5 --until 60 --seed 7",
    "run line5 --pace 1 --gcs udpout:127.0.0.1:14550",
    "run line5 --view --pace 2",
    "run line5 --foxglove 8765",
    "run line5 --ros2 0",
    "run line5 --at 30 'drone3.vehicle.wind[2]=5'",
    "run line5 --replay out/line5",
    "run line5 --partitions 2",
)
def run(
    system: System,
    folder: _Out = None,
    force: _Force = False,
    variant: Variant = None,
    until: Until = None,
    step: Step = None,
    strict: Strict = False,
    pace: _Pace = None,
    seed: _Seed = None,
    settings: Settings = None,
    at: _At = None,
    replay: _Replay = None,
    inputs: _Inputs = None,
    solver: _Solver = None,
    record: _Record = None,
    dataflash: _DataFlash = False,
    threads: _Threads = None,
    gcs: _Gcs = None,
    ports: _Ports = None,
    isolate: _Isolate = None,
    step_timeout: _StepTimeout = None,
    memory_limit: _MemoryLimit = None,
    restart_crashed: _RestartCrashed = None,
    host: _Host = None,
    profile: _Profile = False,
    checkpoint_every: _CheckpointEvery = None,
    origin: _From = None,
    view: _View = False,
    no_open: _NoOpen = False,
    foxglove: _FoxglovePort = None,
    ros1: _Ros1Master = None,
    ros2: _Ros2Domain = None,
    helics: _Helics = None,
    helics_publish: _HelicsPublish = None,
    helics_subscribe: _HelicsSubscribe = None,
    partitions: Partitions = None,
    partition_file: PartitionFile = None,
    partition_timeout: _PartitionTimeout = None,
    as_json: Json = False,
) -> None:
    """Run a system, or one FMU alone."""
    if threads is not None and threads < 1:
        raise usage(f"--threads {threads}: give a positive number")
    if ros1 is not None and not _is_address(ros1):
        raise usage(f"--ros1 {ros1}: give the address of its master, such as http://127.0.0.1:11311")
    if no_open and not view:
        raise usage("--no-open belongs to --view, which is not given")
    if pace is None and any(one is not None for one in (foxglove, ros1, ros2)):
        pace = 1.0
    transport = None
    with errors(as_json=as_json):
        transport = part_of(
            partitions,
            partition_file,
            partition_timeout,
            lambda parts: _cut(system, variant, overrides(settings), until, step, parts, partition_file),
        )
    by_default = Path("out") / Path(system).resolve().stem
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.execution.options import RunOptions
        from cosim_master.execution.preparation.isolating import chosen_isolation
        from cosim_master.network.gateways.mailbox import Mailbox
        from cosim_master.results.storage.manifest_file import CAMPAIGN
        from cosim_master.results.storage.run_folder import RunFolder

        options = RunOptions(
            variant=variant, overrides=overrides(settings), at=changes(at), replay=replay, inputs=inputs,
            solver=solver,
            strict=strict, until=until, step=step, seed=seed,
            out=RunFolder(folder or by_default, numbered=folder is None, force=force),
            record=record or (("*",) if dataflash else ()),
            checkpoint_every=checkpoint_every, origin=origin,
            pace=pace, threads=threads, profile=profile,
            isolation=chosen_isolation(isolate, step_timeout, memory_limit, restart_crashed, host),
            gcs=gcs or (), ports=ports, dataflash=dataflash, assignment=partition_file,
            helics=helics, helics_publish=helics_publish or (), helics_subscribe=helics_subscribe or (),
        )  # fmt: skip
        entered = view or ros1 is not None or ros2 is not None
        if transport is not None and transport.part != 0:
            serve_part(system, options, transport, mailbox=entered)
        with ExitStack() as opened:
            mailbox = Mailbox()
            live = opened.enter_context(shown_live(options, mailbox, open_browser=not no_open)) if view else None
            others = opened.enter_context(served(foxglove, ros1, ros2, mailbox))
            sent = mailbox if entered else None
            opened.push(left(transport))
            hear_end(transport)
            result = _simulate(system, options, doing, live, others, sent, transport)
            if live is not None:
                live.end(result)
    try:
        if as_json:
            print_json(_document(result))
        else:
            _report(result)
        if dataflash and result.folder is not None:
            with errors(as_json=as_json):
                _write_logs(result.folder)
        if folder is None and result.folder is not None and result.folder != by_default:
            campaign = (by_default / CAMPAIGN).is_file()
            holds = "a campaign" if campaign else "a run of other inputs, which --force overwrites"
            note(f"{by_default} holds {holds}; the results are in {result.folder}")
    finally:
        leave(transport, result.error)
    if code := _exit_code(result, strict=strict):
        raise typer.Exit(code)


def _cut(
    system: str,
    variant: str | None,
    values: Mapping[str, str],
    until: float | None,
    step: float | None,
    parts: int,
    file: Path | None,
) -> None:
    """Raises SystemDescriptionError if a system cannot be cut into this many parts."""
    from cosim_master.execution.partitions.cut import cut, read_assignment
    from cosim_master.execution.preparation.prepare import prepare
    from cosim_master.system.flatten.check import check
    from cosim_master.system.reading.read import read_system
    from cosim_master.system.reading.single_fmu import full_names

    with read_system(system, variant) as structure:
        ready = prepare(check(structure, full_names(structure, values)), until=until, step=step)
        cut(ready, parts, None if file is None else read_assignment(file, parts))


def _write_logs(folder: Path) -> None:
    """Writes the DataFlash logs of a run into its folder, in place of earlier ones."""
    from cosim_master.results.export.formats import FORMATS, export_run
    from cosim_master.results.export.options import Options

    (one,) = (one for one in FORMATS if one.name == "dataflash")
    shutil.rmtree(folder / one.name, ignore_errors=True)
    notes(export_run(folder, one, folder / one.name, Options()))


def _is_address(uri: str) -> bool:
    """Returns whether a URI has what a client of ROS 1 needs: the scheme of HTTP, a host and a port."""
    try:
        parts = urlsplit(uri)
        return parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port is not None
    except ValueError:  # a port that is no number
        return False


def _simulate(
    system: str,
    options: RunOptions,
    doing: Activity,
    live: Live | None,
    others: Sequence[Onlooker],
    mailbox: Mailbox | None,
    transport: Transport | None,
) -> RunResult:
    from cosim.kernel import PLAIN
    from cosim_master.execution.options import Listener
    from cosim_master.execution.simulate import simulate

    if options.profile and PLAIN:
        raise usage("--profile needs compiled kernels; NUMBA_DISABLE_JIT is set")
    doing.stage(f"checking {system}")

    onlookers = [*others] if live is None else [live, *others]

    def prepared(ready: Prepared) -> None:
        notes(ready.notes)
        for one in onlookers:
            one.begin(ready)

    judged = None if live is None else live.judged
    listener = Listener(prepared=prepared, stage=doing.stage, progress=doing.run, gateway=note, judged=judged)
    with compiling(doing):
        observers = [one.observer for one in onlookers]
        control = None if live is None else live.control
        return simulate(
            system,
            options,
            listener=listener,
            observers=observers,
            control=control,
            mailbox=mailbox,
            transport=transport,
        )


def _exit_code(result: RunResult, *, strict: bool) -> int:
    if result.outcome == "interrupted":
        return 130
    return int(result.outcome == "failed" or (strict and result.verdict is not None and not result.verdict.good))


_GATEWAYS = 12
"""Gateways whose counts are printed."""


def _report(result: RunResult) -> None:
    if result.error is not None:
        (note if result.outcome == "terminated" else report_error)(str(result.error))
    packets = result.packets
    if result.outcome != "failed" or packets:
        n = result.restarts
        restarts = f", after {n} restart{'s' if n > 1 else ''} of FMUs that crashed" if n else ""
        counts = ", ".join(f"{packets.get(name, 0)} {name}" for name in ("sent", "delivered", "lost"))
        counts += f", {bad} malformed" if (bad := packets.get("malformed", 0)) else ""
        counts += f", {flying} still in flight" if (flying := packets.get("in flight", 0)) else ""
        say(
            f"{result.outcome}{summary(result.verdict)}{restarts}: {result.simulated_s:g} s simulated in "
            f"{result.wall_s:.2f} s ({result.real_time_factor:.1f} times real time)"
        )
        say(f"packets: {counts}")
    if result.folder is not None:
        say(f"results: {result.folder}")
    for gateway, crossed in list(result.gateways.items())[:_GATEWAYS]:
        text = ", ".join(f"{n} {what}" for what, n in crossed.items() if what != "address")
        note(f"{gateway} ({crossed['address']}): {text or 'nothing has crossed'}")
    if (more := len(result.gateways) - _GATEWAYS) > 0:
        note(f"and {more} more gateways")
    if result.profile is not None:
        from cosim_master.cli.views.inspection import profile_tables

        print_tables(profile_tables(result.profile))
    if result.overruns.count:
        note(f"the pace was missed {result.overruns.count} times, by {result.overruns.worst_s:.3f} s at worst")
    show_findings(result.verdict)


def _document(result: RunResult) -> dict[str, Any]:
    """Returns the JSON document of the run."""
    return {
        "outcome": result.outcome,
        "error": None if result.error is None else str(result.error),
        "folder": None if result.folder is None else str(result.folder),
        "simulated_s": result.simulated_s,
        "wall_s": result.wall_s,
        "real_time_factor": result.real_time_factor,
        "packets": dict(result.packets),
        "gateways": {name: dict(counts) for name, counts in result.gateways.items()},
        "overruns": asdict(result.overruns),
        "restarts": result.restarts,
        "notes": list(result.notes),
        "verdict": None if result.verdict is None else result.verdict.as_json(failed=result.outcome == "failed"),
        "profile": None if result.profile is None else asdict(result.profile),
    }
