"""One run: living instances from a checked system, initialized, stepped, observed, and freed again.

    with Execution(checked, ...) as execution:      instantiate, initialize, collect outputs at t0
        execution.advance(k)                        macro steps up to base step k, as often as wanted
    ...                                             recordings completed, instances terminated and freed

The order of calls is that of FMI 2.0.5, section 4.2.4. If an FMU fails, what was recorded stays: files are
completed before anything is freed, since some FMUs take the process with them when they go.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cosim.packets import MAX_PACKET
from cosim_master.diagnostics.errors import FmuError, Problem, SystemDescriptionError
from cosim_master.diagnostics.limitations import CHECKPOINT
from cosim_master.execution.algorithms.discarded_steps import Grid, Snapshot, cannot_be_repeated
from cosim_master.execution.algorithms.iteration import Iteration
from cosim_master.execution.algorithms.richardson import Rejected, Richardson
from cosim_master.execution.events.event_mode import EventMode
from cosim_master.execution.run.checkpoint import cannot_be_serialised, restore, save
from cosim_master.execution.startup.initialize import answers, initialize, instantiate
from cosim_master.execution.startup.rollback_test import self_test
from cosim_master.execution.stimuli import Agenda, Stimuli
from cosim_master.fmi.slaves.fmi2 import STATUS
from cosim_master.fmi.slaves.fmi3 import Instance3
from cosim_master.fmi.slaves.libraries import Libraries, check_sources
from cosim_master.fmi.slaves.slave import Living
from cosim_master.network.radio.build import GATEWAY_BYTES, grown, make_radio
from cosim_master.network.radio.router import (
    DEFERRED,
    DELIVERED,
    FREE_PLACES,
    IN_FLIGHT,
    OUTCOMES,
    USED_EVENTS,
    USED_LOG,
    admit,
    arrived,
    deliver,
)
from cosim_master.results.checkpoint_folder import Checkpoint, Position
from cosim_master.results.recorder import Recorder
from cosim_master.stepping.failures import DISCARD, RunFailed, RunTerminated, discard_failure, raise_failures, reached
from cosim_master.stepping.kernels.macro_step import (
    collect_all,
    end_here,
    next_point,
    places_needed,
    record,
    run,
    sent_bytes,
    work,
)
from cosim_master.stepping.kernels.tables import (
    BASE,
    BLOCK_FULL,
    DELIVER,
    DONE,
    ENDED,
    EVENTS_DUE,
    EVERY,
    FAILED,
    FAILURES,
    FINAL,
    LAST,
    NEED_LOG,
    NEED_PLACES,
    PER_NS,
    PHASE,
    QUIT,
    ROWS,
    SEND,
    START,
    STEPS_DUE,
    K,
)
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.plan import make_plan
from cosim_master.stepping.profiling import Profiler
from cosim_master.stepping.strings import Texts, failing
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.master import Coupling
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import Timing

__all__ = ["Execution", "RunFailed", "RunTerminated"]

_FORGETFUL = "(a Python FMU says this when do_step forgets to return True)"
_SNAPSHOT_EVERY = 0.2
"""Wall-clock seconds."""
_NEVER = 1 << 60
_WORTH_THREADS = 64
"""Free instances from which on several threads step by default."""


class _Discarded(Exception):
    """Steps were discarded, and can be repeated at least `shrink` times shorter.

    Args:
        failures: makes the errors, given the reason for which they are not repeated.
    """

    def __init__(self, failures: Callable[[str], list[FmuError]], shrink: float) -> None:
        self.failures, self.shrink = failures, shrink


class Execution:
    """A system that is being run. Not to be used from two threads at once.

    Args:
        checked: the system; its structure must stay open.
        clock: start, base step and periods.
        places: where values live.
        network: nodes and radio.
        recorder_for: makes the recorder, once everything has been loaded; None records nothing.
        every: rows every so many base steps.
        keep_packets: record packet events and logs.
        threads: how many step native instances; None chooses. Only FMUs built by this project are stepped by
            other threads than the main one: many others keep state in globals, whatever they declare.
        changes: values to be set while it runs, in the order of time.
        stimuli: inputs from a file, sampled.
        profiler: measures where the time goes.
        checkpoint: go on from there.
        coupling: the master; None is Jacobi.
        grid: rows at every base step, also where no step of an instance ends.
        on_stage: is told, in words, what is done next, until the first step.

    Attributes:
        parameters: of each instance, as its FMU answered after initialization.
        notes: where these are not the values set.

    Raises:
        SystemDescriptionError: interpreted FMUs that do not fit together.
        RunFailed: an FMU refused during start-up; everything is freed.
    """

    def __init__(
        self,
        checked: CheckedSystem,
        clock: Timing,
        places: Layout,
        network: Network,
        *,
        recorder_for: Callable[[], Recorder] | None = None,
        every: int = 1,
        keep_packets: bool = True,
        threads: int | None = None,
        changes: Sequence[Change] = (),
        stimuli: Stimuli | None = None,
        profiler: Profiler | None = None,
        checkpoint: Checkpoint | None = None,
        coupling: Coupling | None = None,
        grid: bool = False,
        on_stage: Callable[[str], None] | None = None,
    ) -> None:
        self.checked, self.clock, self.places, self.network = checked, clock, places, network
        self.living: list[Living] = []
        self._libraries = Libraries()
        self._recorder: Recorder | None = None
        self._workers: list[threading.Thread] = []
        self._agenda = Agenda(changes, stimuli, checkpoint.k if checkpoint is not None else 0)
        self._iteration: Iteration | None = None
        self._richardson: Richardson | None = None
        self._every = every
        self._snapshot: Snapshot | None = None
        self._saved_at = -math.inf
        self._crossing = np.zeros(GATEWAY_BYTES, dtype=np.uint8)
        self._phase: Callable[[str], AbstractContextManager[Any]] = profiler.phase if profiler else nullcontext
        try:
            check_sources({i.fmu.path: i.fmu for i in checked.instances}.values())
            tell = on_stage or (lambda _: None)
            tell(f"loading {len(checked.instances)} FMU instances")
            with self._phase("load and instantiate"):
                instantiate(checked, self._libraries, self.living)
            tell(f"initializing {len(checked.instances)} FMU instances")
            with self._phase("initialize"):
                span = (clock.time(0), clock.time(clock.steps))
                delayed = coupling.delays if coupling is not None else {}
                self._event_mode = EventMode(checked, places, self.living, clock.start_ns, delayed)
                self._events = self._event_mode.events
                initialize(checked, self.living, *span, self._events)
                self.parameters, self.notes = answers(checked, self.living)
            sequence = coupling.sequence if coupling is not None else ()
            free = [i for i, living in enumerate(self.living) if living.library.thread_safe and not sequence]
            self.threads = _threads(threads, len(free))
            self.plan = make_plan(
                places,
                clock,
                network,
                self.living,
                every,
                free=free,
                threads=self.threads,
                coupling=coupling,
                grid=grid or (coupling is not None and coupling.variable),
            )
            if profiler is not None:
                profiler.attach(self.plan, self.living)
            keep = recorder_for is not None and keep_packets
            self.radio = make_radio(network, places.ports["Real"].index, keep=keep)
            if coupling is not None and coupling.loops:
                self._trust([i for loop in coupling.loops for i in loop], coupling.algorithm)
                self._iteration = Iteration(self.plan, places, self.living, coupling)
            if coupling is not None and coupling.variable:
                self._trust(range(len(self.living)), coupling.algorithm)
                self._richardson = Richardson(self.plan, places, coupling, clock)
            collect_all(self.plan)
            raise_failures(self.plan, self.places, self.living)
            if recorder_for is not None:
                self._recorder = recorder_for()
            # One call up to k = 0 sends what the instances have to send at the start and records the first row.
            self._texts = Texts(places, self.living)
            self._event_mode.attach(self.plan, self._texts)
            self._grid = Grid(self.plan, clock.periods)
            # What this project compiled never discards a step, so that swarms of it need no copies of their states.
            passed = "what has passed a gateway cannot be taken back" if network.gateways else ""
            self._unrepeatable = cannot_be_repeated(self.living) or passed
            if checkpoint is not None:
                self.refuse_checkpoints()
                self.radio = restore(checkpoint, self.plan, self.radio, self.living, self._texts.outputs)
                self._events.from_json(checkpoint.events)
            if self._richardson is not None:
                self._snapshot = Snapshot(self.living)
            elif not self._unrepeatable and not all(one.library.thread_safe for one in self.living):
                self._snapshot = Snapshot(self.living)
                self._save()
            if network.gateways:
                self._compile_gateways()
            self._start_workers()
            if checkpoint is None:
                self.advance(0)
        except FmuError as error:
            self._free()
            raise RunFailed([error]) from None
        except BaseException:
            self._free()
            if self._recorder is not None:
                self._recorder.close_files()
            raise

    # ---- stepping ----------------------------------------------------------------------------------------------------

    @property
    def k(self) -> int:
        """Base steps done, of the system's own grid."""
        if self._richardson is not None and self.plan.clock[K] >= 0:
            return (self._now - self.clock.start) // self.clock.base
        return int(self.plan.clock[K]) // self._grid.factor

    @property
    def time(self) -> float:
        """Simulation time reached, s."""
        return reached(self.plan)

    def advance(self, k_stop: int) -> None:
        """Macro steps until base step `k_stop`; if the error decides their size, until the next row at least.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, recorded data reaches its start.
            RunTerminated: an FMU wants the simulation to end; the same is true.
        """
        stop = min(k_stop, self.clock.steps)
        if self._richardson is not None:
            self._advance_by_error(stop)
            return
        if self._snapshot is not None and time.perf_counter() - self._saved_at > _SNAPSHOT_EVERY:
            self._save()
        while self.k < stop:
            self._change()
            target = int(min(stop, self._agenda.next))
            if self._grid.until:
                target = min(target, self._grid.until)
            try:
                self._macro_steps(target * self._grid.factor)
            except _Discarded as discarded:
                self._repeat(discarded)
            if self._grid.until and self.k >= self._grid.until:
                self._grid.coarsen()
                self._save()

    def _macro_steps(self, stop: int) -> None:
        if not self._texts:
            self._run(stop)
            return
        # Strings that are no packets are rare and slow to exchange: Python does it, one macro step at a time.
        while self.plan.clock[K] < stop:
            self._texts.set_inputs(self.plan)
            self._run(int(next_point(self.plan, stop)))

    def _change(self) -> None:
        """Set what is to be changed at this communication point."""
        changed = False
        now = self.k if self._richardson is not None else int(self.plan.clock[K])
        if now % self._grid.factor:
            return
        for change in self._agenda.take(now // self._grid.factor):
            with failing(self.plan, self.living[change.instance]):
                self._event_mode.change(change)
            changed = True
        if changed and self._snapshot is not None and self._richardson is None:
            self._save()

    # ---- steps whose size the error decides --------------------------------------------------------------------------

    def _advance_by_error(self, stop: int) -> None:
        """To the first row at or behind base step `stop`: steps end at rows, changes and the end of the run."""
        assert self._richardson is not None
        if self.plan.clock[K] < 0:
            self._macro_steps(0)
        while (k := self.k) < stop:
            self._change()
            target = min((k // self._every + 1) * self._every, self.clock.steps, int(min(self._agenda.next, 2**62)))
            self._richardson.to(self._now, self.clock.start + target * self.clock.base, _Trials(self))
            if target % self._every == 0 or target == self.clock.steps:
                record(self.plan)
                if self._texts:
                    self._read_texts(recorded=True)
                if self.plan.clock[ROWS] == self.plan.ticks.size:
                    self._flush_rows()

    def save_trial(self) -> None:
        """Keep the present state, to come back to it after a trial; `restore_trial` does."""
        assert self._snapshot is not None
        if self._texts:
            self.plan.instances["period"] = 1
            self.plan.clock[START], self.plan.clock[K] = self._now, 0
            self._texts.set_inputs(self.plan)
        counters, radio = self.radio.counters, self.radio
        if 2 * counters[USED_EVENTS] > radio.events.size or 2 * counters[USED_LOG] > radio.log.size:
            self._write_packets()
        self._attempt(lambda snapshot: snapshot.save(self.plan, self.radio))
        self._trial_events = self._events.saved()

    def restore_trial(self) -> None:
        self.radio = self._attempt(lambda snapshot: snapshot.restore(self.plan))
        self._events.restore(self._trial_events)

    def _attempt(self, what: Callable[[Snapshot], Any]) -> Any:
        assert self._snapshot is not None
        for one in self.living:
            one.time = self.time
        try:
            return what(self._snapshot)
        except FmuError as error:
            raise RunFailed([error]) from None

    def step_trial(self, t: int, h: int) -> None:
        """A macro step from `t`, `h` long, ns.

        Raises:
            Rejected: an FMU discards it, or an event ends it earlier.
            RunFailed, RunTerminated: as `advance`.
        """
        clock, rows = self.plan.clock, self.plan.instances
        for place, value in ((START, t), (K, 0), (BASE, h), (LAST, 2), (EVERY, _NEVER), (PHASE, DELIVER)):
            clock[place] = value
        rows["period"] = rows["length"] = 1
        rows["h"] = h / 1e9
        while (reason := run(self.plan, self.radio, 1)) != DONE:
            if reason == NEED_PLACES:
                self.radio = grown(self.radio, int(places_needed(self.plan, self.radio)))
            elif reason == NEED_LOG:
                events, log = np.zeros(2 * self.radio.events.size, self.radio.events.dtype), self.radio.log
                events[: self.radio.events.size] = self.radio.events
                self.radio = self.radio._replace(events=events, log=np.concatenate([log, np.zeros_like(log)]))
            elif reason == EVENTS_DUE:
                first = self._event_mode.returned_early()
                if first < (t + h - 1) / 1e9:
                    raise Rejected(max(t + 1, math.ceil(first * 1e9)))
                self._event_mode.handle()
            else:
                try:
                    self._discards()
                except _Discarded:
                    raise Rejected from None
                raise_failures(self.plan, self.places, self.living)

    # ---- checkpoints -------------------------------------------------------------------------------------------------

    def refuse_checkpoints(self) -> None:
        """Raises SystemDescriptionError if this system can have none, and says why."""
        reason = "what has passed a gateway cannot be taken back" if self.network.gateways else ""
        if reason := reason or cannot_be_serialised(self.living):
            raise SystemDescriptionError([Problem(self.checked.structure.where, CHECKPOINT.text(reason))])

    def save_checkpoint(self, folder: Path, about: Mapping[str, Any]) -> Path:
        """Write a checkpoint of the present communication point, or of the next one on the system's own grid.

        Raises:
            SystemDescriptionError: there are gateways, or FMUs that cannot serialise their state.
            RunFailed: an FMU cannot after all, or steps up to that communication point fail.
        """
        self.refuse_checkpoints()
        while self._grid.until:
            self.advance(self._grid.until)
        self._flush_rows()
        self._write_packets()
        position = Position() if self._recorder is None else self._recorder.position()
        try:
            return save(
                folder,
                time=self.time,
                k=self.k,
                plan=self.plan,
                radio=self.radio,
                living=self.living,
                texts=self._texts.outputs,
                events=self._events.as_json(),
                position=position,
                segments=() if self._recorder is None else self._recorder.segments(),
                about=about,
            )
        except FmuError as error:
            raise RunFailed([error]) from None

    # ---- steps that are discarded ------------------------------------------------------------------------------------

    def _save(self) -> None:
        assert self._snapshot is not None
        self._flush_rows()
        self._flush_packets()
        try:
            self._snapshot.save(self.plan, self.radio)
        except FmuError as error:
            raise RunFailed([error]) from None
        self._saved_texts, self._saved_events = dict(self._texts.outputs), self._events.saved()
        self._saved_at = time.perf_counter()

    def _repeat(self, discarded: _Discarded) -> None:
        """Go back to where the discarded step began, and divide the steps that begin there."""
        assert self._snapshot is not None
        rows, reached = self._rows(), int(self.plan.clock[K])
        done = self._recorded()
        step = float(np.max(self.plan.instances["h"]))
        try:
            self.radio = self._snapshot.restore(self.plan)
            self._texts.outputs |= self._saved_texts
            self._events.restore(self._saved_events)
            if self._recorder is not None:
                self._recorder.take_back()
            self._macro_steps(reached)
        except (FmuError, RunFailed, RunTerminated, _Discarded) as error:
            self._put_back(*done)
            reason = "to repeat it, the run went back to a copy of its state and did not come again to this step"
            raise RunFailed([*discarded.failures(reason), *_failures_of(error)]) from None
        again = self._rows()
        if changed := [name for name in rows if not np.array_equal(rows[name], again[name], equal_nan=True)]:
            self._put_back(*done)
            text = f"the step cannot be repeated: after fmi2SetFMUstate, {', '.join(changed[:3])} went another way"
            owner = next(one.name for one in reversed(self.living) if changed[0].startswith(f"{one.name}."))
            reason = "to repeat it, the run went back to a copy of its state"
            raise RunFailed([*discarded.failures(reason), FmuError(owner, "fmi2SetFMUstate", text, self.time)])
        if self._grid.refine(discarded.shrink) == 0:
            tried = f"shorter steps down to {step:.9g} s did not help"
            raise RunFailed(discarded.failures(tried if self._grid.factor > 1 else f"{step:.9g} s cannot be divided"))
        self._save()

    def _recorded(self) -> tuple[Any, ...]:
        """What has been recorded since rows were last written out, and the radio, for `_put_back`."""
        plan, n = self.plan, int(self.plan.clock[ROWS])
        blocks = [block[:n].copy() for block in (plan.ticks, plan.real_block, plan.int_block)]
        texts = [] if self._recorder is None else self._recorder.unwritten_texts()
        return int(plan.clock[K]), self.radio, blocks, texts

    def _put_back(self, k: int, radio: Any, blocks: Sequence[Any], texts: Sequence[list[str]]) -> None:
        """The recording as it was before a repetition that failed: what was complete stays complete."""
        plan, n = self.plan, len(blocks[0])
        plan.ticks[:n], plan.real_block[:n], plan.int_block[:n] = blocks
        plan.clock[ROWS], plan.clock[K], self.radio = n, k, radio
        if self._recorder is not None:
            self._recorder.take_back()
            for row in texts:
                self._recorder.texts(row)

    def _rows(self) -> dict[str, np.ndarray[Any, Any]]:
        """What has been recorded since rows were last written out, by signal."""
        n = int(self.plan.clock[ROWS])
        reals, integers = (
            self.places.signals["Real"],
            (*self.places.signals["Integer"], *self.places.signals["Boolean"]),
        )
        blocks = ((reals, self.plan.real_block), (integers, self.plan.int_block))
        found = {}
        for columns, block in blocks:
            first = 0
            for name, variable in columns:
                found[name] = block[:n, first : first + 1 + variable.wide].copy()
                first += 1 + variable.wide
        return found

    def _discards(self) -> None:
        """If no instance failed otherwise than by discarding or ending: ask what that means, and raise it."""
        rows = self.plan.instances
        failed = [int(i) for i in np.flatnonzero(rows["failed"][:, 0])]
        ended = [i for i in failed if rows["failed"][i][1] == ENDED]
        discarded = [i for i in failed if tuple(rows["failed"][i][:2]) == DISCARD]
        if len(ended) + len(discarded) < len(failed):
            return
        waiting: list[tuple[int, float | None]] = []
        shrink = 2.0
        ends = [(i, self.time + float(rows["h"][i])) for i in ended]
        for i in discarded:
            living, h = self.living[i], float(rows["h"][i])
            living.time = self.time
            last = living.last_successful_time()
            if living.ended():
                ends.append((i, self.time if last is None else last))
                continue
            if last is not None and last > self.time:
                shrink = max(shrink, h / (last - self.time))
            waiting.append((i, last))

        def failures(reason: str) -> list[FmuError]:
            for i, _ in waiting:
                self.living[i].time = self.time
            return [discard_failure(self.plan, self.living[i], i, last, reason) for i, last in waiting]

        if ends:
            self._terminate(sorted(ends), complete=len(ends) == len(failed))
        if self._unrepeatable or self._snapshot is None:
            raise RunFailed(failures(self._unrepeatable or "it cannot be repeated"))
        raise _Discarded(failures, shrink)

    def _terminate(self, ends: Sequence[tuple[int, float]], *, complete: bool) -> None:
        """Instances (number, until when) want the run to end. If they did this step, it is the last one."""
        said = "terminateSimulation" if self.living[ends[0][0]].fmi == 3 else "fmi2Terminated"
        name, python = self.living[ends[0][0]].name, any(self.living[i].library.python for i, _ in ends)
        rows, clock = self.plan.instances, self.plan.clock
        if python and clock[K] == 0:
            text = f"fmi2Discard: it wants the run to end in its first step {_FORGETFUL}"
            raise RunFailed([self.living[ends[0][0]].failure("fmi2DoStep", STATUS.index("fmi2Discard"), text)])
        end = (clock[START] + (clock[K] + 1) * clock[BASE]) / (1e9 * clock[PER_NS])
        stepped = all(rows[i]["length"] == 1 and time >= end - 1e-9 for i, time in ends)
        if complete and stepped and not self._texts and clock[K] + 1 <= clock[LAST] and self._grid.factor == 1:
            end_here(self.plan, np.array([i for i, _ in ends]))
        raise RunTerminated(name, min(time for _, time in ends), said=said, hint=_FORGETFUL if python else "")

    # ---- gateways ----------------------------------------------------------------------------------------------------

    def admit(self, gateway: int, packets: Sequence[bytes]) -> None:
        """Bring packets into the network by a gateway, at the present time: complete ones whose CRC is not wrong."""
        step = 64
        for first in range(0, len(packets), step):
            some = packets[first : first + step]
            block = np.frombuffer(b"".join(some), dtype=np.uint8)
            need = len(some) * (self.radio.endpoints.size + 1)
            if need > self.radio.counters[FREE_PLACES]:
                self.radio = grown(self.radio, need)
            self._make_room(need, 2 * block.size + 64 * len(some))
            admit(self.radio, self._now, gateway, block, block.size)
        self._saved_at = -math.inf  # what came from outside does not come again

    def take(self, gateway: int) -> bytes:
        """The packets that have arrived at a gateway by now."""
        e = int(self.radio.gateways[gateway]["endpoint"])
        taken = []
        while arrived(self.radio.endpoints, self.radio.places, self._now, e):
            self._make_room(0, int(self.radio.counters[IN_FLIGHT]) * (MAX_PACKET + 16))
            taken.append(self._crossing[: deliver(self.radio, self._now, e, self._crossing)].tobytes())
        self._saved_at = -math.inf
        return b"".join(taken)

    def _compile_gateways(self) -> None:
        """Now, since later a real program would wait for it."""
        admit(self.radio, self._now, 0, np.frombuffer(b"-", dtype=np.uint8), 0)
        e = int(self.radio.gateways[0]["endpoint"])
        arrived(self.radio.endpoints, self.radio.places, self._now, e)
        deliver(self.radio, self._now, e, self._crossing)

    def waiting(self, gateway: int) -> int:
        """Packets that have come in by a gateway and that nobody has read yet, one for each reader."""
        return int(self.radio.gateways[gateway]["waiting"])

    @property
    def _now(self) -> int:
        clock = self.plan.clock
        ticks, per_ns = int(clock[START] + max(clock[K], 0) * clock[BASE]), int(clock[PER_NS])
        return (ticks + per_ns // 2) // per_ns

    def _make_room(self, events: int, log: int) -> None:
        """At least so many free rows of events and bytes of log."""
        if not self.radio.settings[0]["keep"]:
            return
        used = self.radio.counters
        if used[USED_EVENTS] + events <= self.radio.events.size and used[USED_LOG] + log <= self.radio.log.size:
            return
        self._write_packets()
        if events > self.radio.events.size:
            self.radio = self.radio._replace(events=np.zeros(2 * events, dtype=self.radio.events.dtype))
        if log > self.radio.log.size:
            self.radio = self.radio._replace(log=np.zeros(2 * log, dtype=np.uint8))

    def _start_workers(self) -> None:
        for thread in range(1, self.threads):
            worker = threading.Thread(target=work, args=(self.plan, thread), name=f"uav-cosim-{thread}", daemon=True)
            worker.start()
            self._workers.append(worker)

    def _stop_workers(self) -> None:
        if self._workers:
            self.plan.shared[QUIT] = 1
            for worker in self._workers:
                worker.join()
            self._workers.clear()

    def _run(self, stop: int) -> None:
        rows = int(self.plan.clock[ROWS])
        while True:
            reason = run(self.plan, self.radio, stop)
            if reason == DONE:
                if self._texts:
                    self._read_texts(recorded=int(self.plan.clock[ROWS]) != rows)
                return
            if reason == BLOCK_FULL:
                if self._texts:
                    self._read_texts(recorded=True)
                self._flush_rows()
                rows = 0
            elif reason == NEED_PLACES:
                self.radio = grown(self.radio, int(places_needed(self.plan, self.radio)))
            elif reason == NEED_LOG:
                self._flush_packets()
            elif reason == EVENTS_DUE:
                self._handle_events()
                continue
            elif reason == STEPS_DUE:
                self._step_coupled()
                continue
            elif reason == FAILED:
                self._discards()
                raise_failures(self.plan, self.places, self.living)
            if self._snapshot is not None:
                self._save()
                rows = int(self.plan.clock[ROWS])

    def _handle_events(self) -> None:
        rows = int(self.plan.clock[ROWS])
        try:
            self._event_mode.handle()
        except RunTerminated:
            if self._texts and self.plan.clock[ROWS] > rows:
                self._read_texts(recorded=True)
            raise

    def _trust(self, numbers: Sequence[int], why: str) -> None:
        """Let instances show that they can go back to an earlier state."""
        start, steps = self.clock.time(0), self.clock.steps
        sizes = []
        for i in numbers:
            period = self.clock.periods[i]
            sizes.append([self.clock.seconds(period)] * max(1, min(2, steps // period)))
            one = self.living[i]
            if isinstance(one, Instance3) and self.plan.clock[FINAL] == 0:
                one.final = False
        if failures := self_test([self.living[i] for i in numbers], start, sizes, why):
            raise RunFailed(failures)

    def _step_coupled(self) -> None:
        """The steps of a macro step, where it is not the compiled loop that makes them."""
        assert self._iteration is not None
        try:
            self._iteration.step(self.time)
        except FmuError as error:
            raise RunFailed([error]) from None
        if self.plan.clock[FAILURES] > 0:
            self._discards()
            raise_failures(self.plan, self.places, self.living)
        self.plan.clock[PHASE] = SEND
        if self._event_mode.pending:
            self._event_mode.handle()

    def _read_texts(self, *, recorded: bool) -> None:
        """The Strings at the end of a macro step; `recorded`: a row is of this time."""
        try:
            self._texts.get_outputs(self.plan, self._events.kept)
        except RunFailed:
            self.plan.clock[ROWS] -= int(recorded)  # a row without its strings is none
            raise
        if recorded and self._recorder is not None and self.places.string_signals:
            self._recorder.texts(self._texts.row)

    def _flush_rows(self) -> None:
        if self._recorder is not None:
            with self._phase("write results"):
                self._recorder.rows(self.plan)
        self.plan.clock[ROWS] = 0

    def _flush_packets(self) -> None:
        """Write the packet blocks out, and make them large enough for what comes next."""
        self._write_packets()
        sending = 3 * int(sent_bytes(self.plan))
        delivering = (int(self.radio.counters[IN_FLIGHT]) + 64) * (MAX_PACKET + 16)
        self._make_room(int(places_needed(self.plan, self.radio)), max(sending, delivering))

    def _write_packets(self) -> None:
        if self._recorder is not None:
            with self._phase("write results"):
                self._recorder.packets(self.radio)
        self.radio.counters[[USED_EVENTS, USED_LOG]] = 0

    # ---- results -----------------------------------------------------------------------------------------------------

    def packet_counts(self) -> dict[str, int]:
        """Packets by radio, one for each node a packet was for: sent = delivered + lost + in flight. On board apart."""
        count = self.radio.counters
        lost = {OUTCOMES[i].removeprefix("lost: "): int(count[i]) for i in range(2, 6)}
        sent = int(count[1]) + sum(lost.values())
        delivered = int(count[DELIVERED])
        return {
            "sent": sent,
            "delivered": delivered,
            "lost": sum(lost.values()),
            "in flight": int(count[1]) - delivered,
            **{f"lost: {cause}": n for cause, n in lost.items()},
            "malformed": int(count[6]),
            "on board": int(count[0]),
            "deferred": int(count[DEFERRED]),
        }

    def finish(self, manifest: Callable[[], Mapping[str, Any]]) -> None:
        """Complete the recording; call once, before leaving the context."""
        if self._recorder is not None:
            self._recorder.rows(self.plan)
            self._recorder.packets(self.radio)
            self._recorder.close(manifest())

    def end(self, manifest: Callable[[Sequence[FmuError]], Mapping[str, Any]]) -> tuple[FmuError, ...]:
        """Terminate and free all instances; returns how that failed. Call once, after `finish`.

        Args:
            manifest: makes a new manifest, if it did: it takes the place of the one that `finish` wrote.
        """
        failures = tuple(self._free())
        if failures and self._recorder is not None:
            self._recorder.write_manifest(manifest(failures))
        return failures

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        failures = self._free()
        if failures and kind is None:
            raise RunFailed(failures)

    def _free(self) -> list[FmuError]:
        """Terminate and free what is alive, each once, whatever the others do."""
        self._stop_workers()
        failures = []
        if self._snapshot is not None:
            self._snapshot.close()
            self._snapshot = None
        if self._iteration is not None:
            self._iteration.close()
        for living in self.living:
            try:
                living.terminate()
            except FmuError as error:
                failures.append(error)
        for living in self.living:
            try:
                living.free()
            except FmuError as error:
                failures.append(error)
        self._libraries.__exit__(None, None, None)
        return failures


def _failures_of(error: Exception) -> list[FmuError]:
    """What went wrong in a repetition, where it is more than another discarded step."""
    if isinstance(error, FmuError):
        return [error]
    return list(error.failures) if isinstance(error, RunFailed) else []


class _Trials:
    """An execution as Richardson's `World`."""

    def __init__(self, execution: Execution) -> None:
        self.save, self.restore = execution.save_trial, execution.restore_trial
        self.step, self.next_event = execution.step_trial, execution._event_mode.next_event


def _threads(wanted: int | None, free: int) -> int:
    """How many threads step: for few instances, handing them over costs more than it gains."""
    if wanted is None:
        wanted = (os.cpu_count() or 1) if free >= _WORTH_THREADS else 1
    return max(1, min(wanted, free))
