"""Plans a run as far as possible without loading an FMU: its inputs, programs, folder, checkpoints and signals."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.execution.federation import Federation, Joining, joining
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.manifest import digest_of_system
from cosim_master.execution.pacing import Checkpoints
from cosim_master.execution.preparation.fingerprint import fingerprint_of, with_packets
from cosim_master.execution.preparation.prepare import Prepared, prepare
from cosim_master.execution.preparation.replay import NOTHING, Actions, entering, read_actions
from cosim_master.execution.preparation.stimuli import read_stimuli
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.network.gateways.gateways import Address, gateways_of
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.network.gateways.sockets import Socket
from cosim_master.results.recording.recording import check_columns
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.results.storage.run_folder import RunFolder
from cosim_master.stepping.layout import Layout, make_layout
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.single_fmu import as_model_exchange, full_names, full_patterns
from cosim_master.system.settings.changes import Change, told
from cosim_master.system.settings.network import Gateway, with_gateways
from cosim_master.system.structure import SystemStructure
from cosim_master.verdict.monitors.declared import monitored
from cosim_master.verdict.monitors.monitoring import hears_packets
from cosim_master.verdict.watching.subjects import watched

__all__ = ["Planned", "planned"]

_MAILBOX = "@page"
"""The node of packets from the mailbox."""
_CHECKPOINTS = "a run with checkpoints takes no packets: what has passed a gateway cannot be taken back"


@dataclass(frozen=True, slots=True)
class Planned:
    """A run whose system is checked.

    Attributes:
        checkpoint: the one that the run goes on from; None: it begins at its start.
        asked: the gateways, and their addresses or sockets.
        mailbox: takes packets from outside during the run.
        out: the folder of the results; None: nothing is recorded.
        saving: the checkpoints that the run saves.
        federation: of the run and other simulators; None: there are no others.
        packets: whether packets are kept for the recording or for monitors.
        replayed: whether packets of an earlier run enter again.
    """

    ready: Prepared
    options: RunOptions
    checkpoint: Checkpoint | None
    asked: Sequence[tuple[Gateway, Address | Socket]]
    mailbox: Mailbox | None
    fingerprint: dict[str, str]
    out: Path | None
    saving: Checkpoints
    layout: Layout
    federation: Federation | None
    packets: bool
    replayed: bool


def planned(
    structure: SystemStructure,
    options: RunOptions,
    checkpoint: Checkpoint | None,
    mailbox: Mailbox | None,
) -> Planned:
    """Returns the plan of a run, whose packets may also enter by `mailbox`.

    Raises:
        SystemDescriptionError: the description is invalid, or the run cannot have its folder or its checkpoints.
    """
    actions = NOTHING if options.replay is None else read_actions(options.replay)
    ready, overrides = _prepared(structure, options, actions)
    replayed = entering(actions.posted, ready.clock)
    asked: list[tuple[Gateway, Address | Socket]] = [*gateways_of(ready.network, options.gcs, options.ports)]
    how = _joining(ready, options)
    asked += () if how is None else how.gateways
    programs = [f"{gateway} {address}" for gateway, address in asked]
    programs += [] if how is None else [f"HELICS {options.helics}"]
    fingerprint = _fingerprint(ready, programs, checkpoint)
    out = options.out
    if isinstance(out, RunFolder):
        out = out.choose(with_packets(fingerprint, replayed), repeatable=not programs and not replayed)
    saving = Checkpoints(ready, out, options.checkpoint_every, overrides, options.record)
    if checkpoint is not None:
        checkpoint.check(saving.identity)
        if out is not None and out.resolve() == checkpoint.run.resolve():
            text = "this is the folder of the run that it goes on from; give another folder"
            raise SystemDescriptionError([Problem(Where(str(out)), text)])
        ready = replace(ready, changes=_later(ready, checkpoint))
        if dropped := _dropped(ready, checkpoint):
            text = f"{checkpoint.run} also had changes after {checkpoint.time:g} s, which are not made here; --replay"
            ready = _noting(ready, f"{text} {checkpoint.run} makes them: {', '.join(dropped[:3])}")
        saving.changes = [*checkpoint.changes, *(told(ready.checked, change) for change in ready.changes)]
    if saving.none_from(0 if checkpoint is None else checkpoint.k):
        ready = _noting(ready, _NO_CHECKPOINT.format(ready.clock.time(ready.clock.steps), options.checkpoint_every))
    if replayed:
        mailbox = mailbox or Mailbox()
        mailbox.repeat(replayed)
    if mailbox is not None and (checkpoint is not None or options.checkpoint_every is not None):
        mailbox.refusal = _CHECKPOINTS
        if replayed:
            raise SystemDescriptionError([Problem(Where("--replay"), _CHECKPOINTS)])
    elif mailbox is not None:
        asked.append((Gateway(_MAILBOX, quiet=True), mailbox))
    ready = replace(ready, network=with_gateways(ready.network, [gateway for gateway, _ in asked]))
    observed = watched(ready.checked) | monitored(ready.monitors) | ({*how.observed} if how is not None else set())
    layout = make_layout(ready.checked, ready.network, ready.recording.signals, ready.master, observed)
    if checkpoint is not None:
        check_columns(checkpoint, ready.checked, layout)
    return Planned(
        ready=ready,
        options=options,
        checkpoint=checkpoint,
        asked=asked,
        mailbox=mailbox,
        fingerprint=fingerprint,
        out=out,
        saving=saving,
        layout=layout,
        replayed=bool(replayed),
        federation=None if how is None else Federation(how, layout),
        packets=(out is not None and ready.recording.packets) or hears_packets(ready.monitors),
    )


_NO_CHECKPOINT = "no checkpoint is written: the run ends at {:g} s, and would have them every {:g} s before its end"


def _noting(ready: Prepared, text: str) -> Prepared:
    return replace(ready, checked=replace(ready.checked, notes=(*ready.checked.notes, text)))


def _later(ready: Prepared, checkpoint: Checkpoint) -> tuple[Change, ...]:
    """Returns the changes from a checkpoint on.

    Raises:
        SystemDescriptionError: a change before it is not one that has led to it.
    """
    problems = []
    for change in ready.changes:
        if change.k < checkpoint.k and (made := told(ready.checked, change)) not in checkpoint.changes:
            _, name, value = made
            where = Where(f"--at {ready.clock.time(change.k):g} {name}={value}")
            text = f"it is before the checkpoint at {checkpoint.time:g} s, and has not led to it"
            problems.append(Problem(where, f"{text}; give a later time, or an earlier checkpoint"))
    if problems:
        raise SystemDescriptionError(problems)
    return tuple(change for change in ready.changes if change.k >= checkpoint.k)


def _dropped(ready: Prepared, checkpoint: Checkpoint) -> list[str]:
    """Returns the changes after a checkpoint that the run with the checkpoint was to have, and this one has not."""
    known = {(change.k, told(ready.checked, change)[1]) for change in ready.changes}
    try:
        found = json.loads((checkpoint.run / "manifest.json").read_text(encoding="utf-8"))["changes"]
        later = [(ready.clock.step_at(float(one["time"])), str(one["variable"])) for one in found]
    except (OSError, ValueError, KeyError, TypeError):  # the checkpoint does without its manifest
        return []
    return [
        f"{name} at {ready.clock.time(k):g} s"
        for k, name in later
        if k is not None and k >= checkpoint.k and (k, name) not in known
    ]


def _joining(ready: Prepared, options: RunOptions) -> Joining | None:
    """Returns how the run takes part in a federation; None if it does not.

    Raises:
        SystemDescriptionError: an address or a name is wrong, or the run cannot take part.
    """
    if options.helics is None:
        for name, given in (("publish", options.helics_publish), ("subscribe", options.helics_subscribe)):
            if given:
                text = "it belongs to --helics, which is not given"
                raise SystemDescriptionError([Problem(Where(f"--helics-{name}"), text)])
        return None
    if options.checkpoint_every is not None or options.origin is not None:
        text = "a run in a federation has no checkpoints: other simulators cannot be set back"
        raise SystemDescriptionError([Problem(Where("--helics"), text)])
    return joining(ready, options.helics, options.helics_publish, options.helics_subscribe)


def _prepared(structure: SystemStructure, options: RunOptions, actions: Actions) -> tuple[Prepared, dict[str, str]]:
    """Returns the prepared system, and the overrides with full names."""
    if options.solver is not None:
        structure = as_model_exchange(structure)
    overrides = full_names(structure, options.overrides)
    given = [*actions.at, *options.at]
    at = [(when, *named) for when, name, text in given for named in full_names(structure, {name: text}).items()]
    checked = check(structure, overrides)
    if options.solver is not None:
        checked = _with_solver(checked, options.solver)
    ready = prepare(
        checked,
        until=options.until,
        step=options.step,
        seed=options.seed,
        record=full_patterns(structure, options.record, (v for one in checked.instances for v in one.fmu.variables)),
        at=at,
        strict=options.strict,
        stimuli=None if options.inputs is None else read_stimuli(options.inputs, checked, [*overrides]),
    )
    return ready, overrides


def _with_solver(checked: CheckedSystem, text: str) -> CheckedSystem:
    """Returns the system with this solver for all its instances of Model Exchange.

    Raises:
        SystemDescriptionError: the solver does not exist, or the system has no instance for it.
    """
    try:
        choice = Choice.parsed(text)
        if all(instance.solver is None for instance in checked.instances):
            raise ValueError("no FMU of this system is for Model Exchange: all have solvers of their own")
    except ValueError as error:
        raise SystemDescriptionError([Problem(Where(f"--solver {text}"), str(error))]) from None
    instances = [one.integrated(choice) if one.solver is not None else one for one in checked.instances]
    return replace(checked, instances=tuple(instances))


def _fingerprint(ready: Prepared, gateways: Sequence[str], checkpoint: Checkpoint | None) -> dict[str, str]:
    return fingerprint_of(
        ready.checked,
        ready.clock,
        ready.network,
        ready.master,
        system=digest_of_system(ready.checked),
        changes=ready.changes,
        stimuli="" if ready.stimuli is None else ready.stimuli.digest,
        recording=(ready.every, ready.recording.signals, ready.recording.packets),
        gateways=gateways,
        checkpoint=checkpoint,
    )
