"""One run: living instances from a checked system, initialized, stepped, observed, and freed again.

    with Execution(checked, ...) as execution:      instantiate, initialize, collect outputs at t0
        execution.advance(k)                        macro steps up to base step k, as often as wanted
    ...                                             recordings completed, instances terminated and freed

The order of calls is that of FMI 2.0.5, section 4.2.4. If an FMU fails, what was recorded stays: files are
completed before anything is freed, since some FMUs take the process with them when they go.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self, TypeAlias

import numpy as np

from cosim_master.check import CheckedSystem, Link
from cosim_master.errors import CosimError, FmuError
from cosim_master.fmi2 import STATUS
from cosim_master.fmi2 import Instance as Living
from cosim_master.fmu import Variable
from cosim_master.loading import Libraries, check_sources
from cosim_master.network import Network
from cosim_master.plan import KINDS, Layout, Timing, grown, make_plan, make_radio
from cosim_master.radio import DEFERRED, DELIVERED, IN_FLIGHT, OUTCOMES, USED_EVENTS, USED_LOG
from cosim_master.recorder import Recorder
from cosim_master.stepping import (
    BLOCK_FULL,
    DONE,
    FAILED,
    FAILURES,
    FUNCTIONS,
    NEED_LOG,
    NEED_PLACES,
    NOT_A_NUMBER,
    NOT_BASE64,
    QUIT,
    ROWS,
    TOO_LONG,
    K,
    collect_all,
    places_needed,
    run,
    sent_bytes,
    work,
)

__all__ = ["Execution", "RunFailed"]

_TextLink: TypeAlias = tuple[tuple[int, str], int, Variable]
"""From which output (instance, name) a String goes to which instance's input."""

_WORTH_THREADS = 64
"""Free instances from which on several threads step by default."""


class RunFailed(CosimError):
    """One or more instances failed in the same macro step.

    Attributes:
        failures: an FmuError for each of them.
    """

    def __init__(self, failures: Sequence[FmuError]) -> None:
        self.failures = tuple(failures)
        super().__init__("\n".join(str(failure) for failure in failures))


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
    ) -> None:
        self.checked, self.clock, self.places, self.network = checked, clock, places, network
        self.living: list[Living] = []
        self._libraries = Libraries()
        self._recorder: Recorder | None = None
        self._workers: list[threading.Thread] = []
        try:
            check_sources({i.fmu.path: i.fmu for i in checked.instances}.values())
            self._instantiate()
            self._initialize()
            free = [i for i, living in enumerate(self.living) if living.library.thread_safe]
            self.threads = _threads(threads, len(free))
            self.plan = make_plan(places, clock, network, self.living, every, free=free, threads=self.threads)
            keep = recorder_for is not None and keep_packets
            self.radio = make_radio(network, places, keep=keep)
            collect_all(self.plan)
            self._raise_failures()
            if recorder_for is not None:
                self._recorder = recorder_for()
            # One call up to k = 0 sends what the instances have to send at the start and records the first row.
            self._text_links, self._text_outputs = self._strings()
            self._start_workers()
            self.advance(0)
        except FmuError as error:
            self._free()
            raise RunFailed([error]) from None
        except BaseException:
            self._free()
            raise

    # ---- start-up ----------------------------------------------------------------------------------------------------

    def _instantiate(self) -> None:
        for instance in self.checked.instances:
            self.living.append(self._libraries.load(instance.fmu).instantiate(instance.name))

    def _initialize(self) -> None:
        """Start values, experiment, initialization mode with its exchange, and out of it again."""
        start, stop = self.clock.start / 1e9, (self.clock.start + self.clock.steps * self.clock.base) / 1e9
        values = [instance.effective_values() for instance in self.checked.instances]
        for living, instance, starts in zip(self.living, self.checked.instances, values, strict=True):
            _set_all(living, [instance.fmu.variables[n] for n in starts], starts, inputs=False)
            living.setup_experiment(start, stop)
        for living, instance, starts in zip(self.living, self.checked.instances, values, strict=True):
            living.enter_initialization_mode()
            _set_all(living, [instance.fmu.variables[n] for n in starts], starts, inputs=True)
        self._exchange_initially()
        for living in self.living:
            living.exit_initialization_mode()

    def _exchange_initially(self) -> None:
        """Stage by stage: get all sources of a stage at once, then set its targets."""
        number = {living.name: living for living in self.living}
        for stage in self.checked.init_order:
            sources: dict[str, dict[str, Variable]] = {}
            targets: dict[str, list[Link]] = {}
            for link in (self.checked.links[i] for i in stage):
                name, variable = link.source
                sources.setdefault(name, {})[variable] = number[name].library.fmu.variables[variable]
                targets.setdefault(link.target[0], []).append(link)
            got: dict[tuple[str, str], Any] = {}
            for name, variables in sources.items():
                for kind in _kinds(list(variables.values())):
                    chosen = [v for v in variables.values() if _kind(v) == kind]
                    values = number[name].get(chosen)
                    got |= {(name, v.name): value for v, value in zip(chosen, values, strict=True)}
            for name, links in targets.items():
                living = number[name]
                new = {link.target[1]: link.converted(got[link.source]) for link in links}
                _set_all(living, [living.library.fmu.variables[n] for n in new], new, inputs=None)

    # ---- stepping ----------------------------------------------------------------------------------------------------

    @property
    def k(self) -> int:
        """Base steps done."""
        return int(self.plan.clock[K])

    @property
    def time(self) -> float:
        """Simulation time reached, s."""
        return (self.clock.start + max(self.k, 0) * self.clock.base) / 1e9

    def advance(self, k_stop: int) -> None:
        """Macro steps until base step `k_stop`.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, recorded data reaches its start.
        """
        stop = min(k_stop, self.clock.steps)
        if not self._text_outputs:
            self._run(stop)
            return
        # Strings that are no packets are rare and slow to exchange: Python does it, one macro step at a time.
        while self.k < stop:
            self._set_strings()
            self._run(self.k + 1)

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
                if self._text_outputs:
                    self._get_strings(recorded=int(self.plan.clock[ROWS]) != rows)
                return
            if reason == BLOCK_FULL:
                if self._text_outputs:
                    self._get_strings(recorded=True)
                self._flush_rows()
                rows = 0
            elif reason == NEED_PLACES:
                self.radio = grown(self.radio, int(places_needed(self.plan, self.radio)))
            elif reason == NEED_LOG:
                self._flush_packets()
            elif reason == FAILED:
                self._raise_failures()

    def _flush_rows(self) -> None:
        if self._recorder is not None:
            self._recorder.rows(self.plan)
        self.plan.clock[ROWS] = 0

    def _flush_packets(self) -> None:
        """Write the packet blocks out, and make them large enough for what comes next."""
        if self._recorder is not None:
            self._recorder.packets(self.radio)
        self.radio.counters[[USED_EVENTS, USED_LOG]] = 0
        events = int(places_needed(self.plan, self.radio))
        size = max(3 * int(sent_bytes(self.plan)), (int(self.radio.counters[IN_FLIGHT]) + 64) * 300)
        if events > self.radio.events.size:
            self.radio = self.radio._replace(events=np.zeros(2 * events, dtype=self.radio.events.dtype))
        if size > self.radio.log.size:
            self.radio = self.radio._replace(log=np.zeros(2 * size, dtype=np.uint8))

    def _strings(self) -> tuple[list[_TextLink], dict[tuple[int, str], str]]:
        """Connections of Strings, and the value of every String output that is connected or recorded."""
        number = {living.name: i for i, living in enumerate(self.living)}
        links: list[_TextLink] = []
        outputs: dict[tuple[int, str], str] = {}
        for link in self.places.strings:
            source, target = (number[link.source[0]], link.source[1]), number[link.target[0]]
            links.append((source, target, self.living[target].library.fmu.variables[link.target[1]]))
            outputs[source] = ""
        for _, instance, variable in self.places.string_signals:
            outputs[number[instance.name], variable.name] = ""
        return links, outputs

    def _set_strings(self) -> None:
        """Inputs of the instances that are due, from the outputs that `_get_strings` got."""
        for source, target, variable in self._text_links:
            if self.k >= 0 and self.k % self.clock.periods[target] == 0:
                with self._failing(target) as living:
                    living.set([variable], [self._text_outputs[source]])

    def _get_strings(self, *, recorded: bool) -> None:
        """Outputs of the instances whose step has just ended: what the others would answer now is of the future."""
        try:
            for i, name in self._text_outputs:
                if self.k % self.clock.periods[i] == 0 or self.k == self.clock.steps:
                    with self._failing(i) as living:
                        (self._text_outputs[i, name],) = living.get([living.library.fmu.variables[name]])
        except RunFailed:
            self.plan.clock[ROWS] -= int(recorded)  # a row without its strings is none
            raise
        if recorded and self._recorder is not None and self.places.string_signals:
            number = {living.name: i for i, living in enumerate(self.living)}
            signals = self.places.string_signals
            self._recorder.texts([self._text_outputs[number[one.name], v.name] for _, one, v in signals])

    @contextmanager
    def _failing(self, i: int) -> Iterator[Living]:
        self.living[i].time = self.time
        try:
            yield self.living[i]
        except FmuError as error:
            raise RunFailed([error]) from None

    def _raise_failures(self) -> None:
        if self.plan.clock[FAILURES] == 0:
            return
        failures = []
        failed = self.plan.instances["failed"]
        for i in np.flatnonzero(failed[:, 0]):
            function, status, detail = (int(x) for x in failed[i])
            living = self.living[i]
            living.time = self.time
            text, code = "", status
            if status == NOT_A_NUMBER:
                name = self.places.ports["Real"].outputs[detail][1].name
                text, code = f"{name} is not a number", 0
            elif status in (TOO_LONG, NOT_BASE64):
                wrong = "is longer than its declared capacity" if status == TOO_LONG else "is not base64 text"
                text, code = f"its packet output {wrong}", 0
            elif status == STATUS.index("fmi2Discard"):
                text = "fmi2Discard: it could not do this step, and steps are not repeated"
                if living.library.python:
                    text += " (a Python FMU says this when do_step forgets to return True)"
            failures.append(living.failure(FUNCTIONS[function], code, text))
        raise RunFailed(failures)

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
        for living in self.living:
            try:
                living.terminate()
            except FmuError as error:
                failures.append(error)
        for living in self.living:
            living.free()
        self._libraries.__exit__(None, None, None)
        return failures


def _threads(wanted: int | None, free: int) -> int:
    """How many threads step: for few instances, handing them over costs more than it gains."""
    if wanted is None:
        wanted = (os.cpu_count() or 1) if free >= _WORTH_THREADS else 1
    return max(1, min(wanted, free))


def _kind(variable: Variable) -> str:
    return "Integer" if variable.type == "Enumeration" else variable.type


def _kinds(variables: Sequence[Variable]) -> list[str]:
    return [kind for kind in (*KINDS, "String") if any(_kind(v) == kind for v in variables)]


def _set_all(living: Living, variables: Sequence[Variable], values: Mapping[str, Any], *, inputs: bool | None) -> None:
    """Set the variables that are inputs, those that are not, or (None) all; one call per type."""
    chosen = [v for v in variables if inputs is None or (v.causality == "input") == inputs]
    for kind in _kinds(chosen):
        some = [v for v in chosen if _kind(v) == kind]
        living.set(some, [values[v.name] for v in some])
