"""The clock of a run: an integer count of ticks, a base step, and each instance's period in base steps.

A tick is a nanosecond, or an integral fraction of one if a step size is a fraction such as 1/30 s. Communication points
are start + k*base in ticks; they are exact and never accumulated. FMUs receive the nearest double of a point and of a
step. Radio and events of Clocks use whole nanoseconds, the nearest ones.

The step size of an FMU is, in this order of precedence: --step of the command line; the nearest annotation
org.uav-cosim.stepping, on the component or a surrounding system; the proposal of the FMU (DefaultExperiment).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.diagnostics.limitations import BASE_STEP, FINE_STEPS, OVERRUN, TIED_STEPS, WHOLE_TIMES
from cosim_master.system.flatten.clock_groups import lockstep
from cosim_master.system.flatten.flat import DEFAULT_STEP, CheckedSystem, ComponentInstance

__all__ = ["DEFAULT_DURATION", "TimeGrid", "exact", "time_grid"]

_NANO = 1_000_000_000
DEFAULT_DURATION = 1.0
"""Duration of a run for which nothing names a stop time, s: that of OMSimulator, FMPy and libcosim's program."""
_LARGEST_DENOMINATOR = 100_000
"""Largest denominator of a fraction of a second that is recognised in a decimal number."""
_LARGEST_TICK = 1 << 62


@dataclass(frozen=True, slots=True)
class TimeGrid:
    """The clock of a run: start and base step in ticks, number of base steps, and periods of instances in base steps.

    Attributes:
        per_ns: ticks per nanosecond.
        sources: for each instance, the origin of its step size: "--step", "system", "FMU" or "default".
    """

    start: int
    base: int
    steps: int
    periods: tuple[int, ...]
    notes: tuple[str, ...] = ()
    per_ns: int = 1
    sources: tuple[str, ...] = ()

    @property
    def start_ns(self) -> int:
        """Start time, ns."""
        return self.start // self.per_ns

    @property
    def grids(self) -> tuple[int, ...]:
        """The different periods, if no instance steps by the base step; otherwise none."""
        return () if 1 in self.periods else tuple(sorted(set(self.periods)))

    def seconds(self, steps: int) -> float:
        """Returns the duration of a number of base steps, s."""
        return steps * self.base / (_NANO * self.per_ns)

    def time(self, k: int) -> float:
        """Returns the communication point t_k, s."""
        return (self.start + k * self.base) / (_NANO * self.per_ns)

    def step_at(self, time: float) -> int | None:
        """Returns the base step that begins at `time` [s], or at which the run ends; None if none does."""
        ticks = time * _NANO * self.per_ns - self.start
        if not abs(ticks) < _LARGEST_TICK:
            return None
        k = round(ticks / self.base)
        return k if 0 <= k <= self.steps and abs(k * self.base - ticks) < 0.5 * self.per_ns else None


def exact(seconds: float) -> Fraction | None:
    """Returns a step size as a fraction in nanoseconds; None if it is not a positive number.

    Whole nanoseconds are exact. Another number is interpreted as the simplest fraction with a denominator of at most
    100000 that equals it to ten digits (0.03333333333 is 1/30), or else as written.
    """
    if not math.isfinite(seconds) or seconds <= 0:
        return None
    if not math.isfinite(seconds * _NANO):
        return Fraction(seconds) * _NANO
    ticks = round(seconds * _NANO)
    if ticks > 0 and math.isclose(ticks, seconds * _NANO, rel_tol=1e-12, abs_tol=1e-4):
        return Fraction(ticks)
    simple = Fraction(seconds).limit_denominator(_LARGEST_DENOMINATOR)
    if simple > 0 and abs(simple - Fraction(seconds)) <= Fraction(seconds) / 10**9:
        return simple * _NANO
    return Fraction(repr(seconds)) * _NANO


def _ticks(seconds: float) -> int | None:
    """Returns a time in s as nanoseconds; None if it is not a whole number of them."""
    if not math.isfinite(seconds * _NANO):
        return None
    ticks = round(seconds * _NANO)
    return ticks if math.isclose(ticks, seconds * _NANO, rel_tol=1e-12, abs_tol=1e-4) else None


def time_grid(
    checked: CheckedSystem, until: float | None = None, step: float | None = None, *, gridless: bool = False
) -> TimeGrid:
    """Chooses the clock.

    Args:
        until: stop time in s; None uses the system's DefaultExperiment, or else 1 s after its start, with a note.
        step: step size in s of all instances, which overrides system and FMUs.
        gridless: the master chooses the sizes of steps, which do not end on a grid: the base step is a nanosecond, and
            the step sizes are those of the first steps.

    Raises:
        SystemDescriptionError: no step size, start or stop within a nanosecond, or a run whose end an FMU with a
            fixed step size would overrun.
    """
    problems: list[Problem] = []
    where = checked.structure.where
    stop = until if until is not None else checked.stop_time
    if default := stop is None:
        stop = checked.start_time + DEFAULT_DURATION
    start_ticks = _ticks(checked.start_time)
    stop_ticks = _ticks(stop)
    if stop <= checked.start_time:
        problems.append(Problem(where, f"stop time {stop:g} s is not after start time {checked.start_time:g} s"))
    elif (abs(checked.start_time) + stop - checked.start_time) * _NANO >= _LARGEST_TICK and math.isfinite(stop):
        text = f"a run from {checked.start_time:g} s to {stop:g} s: time is counted in ns, up to 4.6e9 s (146 years)"
        problems.append(Problem(where, text))
    elif start_ticks is not None and start_ticks == stop_ticks:
        text = f"stop time {stop:g} s is less than a nanosecond after start time {checked.start_time:g} s"
        problems.append(Problem(where, text))
    elif start_ticks is None or stop_ticks is None:
        problems.append(Problem(where, WHOLE_TIMES.text()))
    sizes: list[Fraction] = []
    tables = [one for one in checked.instances if one.fmu.table is not None]
    for instance in checked.instances:
        size = step if step is not None else instance.step_size
        if size is None and instance.fmu.table is not None and len(tables) < len(checked.instances):
            continue
        ns = None if size is None else exact(size)
        if size is None:
            text = f"{instance.name}: no step size: neither the system nor the FMU names one; give one with --step"
            problems.append(Problem(instance.where, text))
        elif ns is None:
            text = f"{instance.name}: step size {size:g} s; it must be a positive number of seconds"
            problems.append(Problem(instance.where, text))
        else:
            sizes.append(ns)
    if problems:
        raise SystemDescriptionError(problems)
    assert start_ticks is not None and stop_ticks is not None
    if not checked.instances:
        return TimeGrid(start_ticks, stop_ticks - start_ticks, 1, ())
    if len(sizes) < len(checked.instances):
        sizes = _with_tables(checked.instances, sizes)
    clock = (_gridless if gridless else _clock)(checked, start_ticks, stop_ticks - start_ticks, sizes, step)
    if not default:
        return clock
    text = f"nothing names a stop time: the run ends at {stop:g} s; --until gives another"
    return replace(clock, notes=(text, *clock.notes))


def _gridless(
    checked: CheckedSystem, start: int, length: int, sizes: Sequence[Fraction], step: float | None
) -> TimeGrid:
    sources = tuple("--step" if step is not None else one.step_source for one in checked.instances)
    periods = tuple(max(1, round(size)) for size in sizes)
    return TimeGrid(start, 1, length, periods, tuple(_step_notes(checked.instances, sources, step)), 1, sources)


def _with_tables(instances: Sequence[ComponentInstance], sizes: Sequence[Fraction]) -> list[Fraction]:
    """Returns the step sizes of all instances; tables without one have a new value whenever another instance steps."""
    per_ns = math.lcm(*(size.denominator for size in sizes))
    shared = Fraction(math.gcd(*(int(size * per_ns) for size in sizes)), per_ns)
    given = iter(sizes)
    return [shared if one.fmu.table is not None and one.step_size is None else next(given) for one in instances]


def _clock(checked: CheckedSystem, start: int, length: int, sizes: Sequence[Fraction], step: float | None) -> TimeGrid:
    """Returns the time grid of a run of `length` ns whose instances step by `sizes`, ns."""
    where, problems = checked.structure.where, []
    per_ns = math.lcm(*(size.denominator for size in sizes))
    if (abs(start) + length) * per_ns >= _LARGEST_TICK:
        worst = max(sizes, key=lambda size: size.denominator)
        text = FINE_STEPS.text(f"{float(worst) / _NANO:.17g}", f"{max(1, round(worst)) / _NANO:.9g}")
        raise SystemDescriptionError([Problem(checked.instances[sizes.index(worst)].where, text)])
    ticks = [int(size * per_ns) for size in sizes]
    base, total = math.gcd(*ticks), length * per_ns
    if per_ns > 1 and 2 * abs(total - round(total / base) * base) < per_ns:
        total = round(Fraction(total, base)) * base  # the stop time is a fraction, too, as written with limited digits
    per_second = _NANO * per_ns
    if total % base:
        nearest = ((total // base + 1) * base + start * per_ns) / per_second
        text = BASE_STEP.text(f"{total / per_second:.9g}", f"{base / per_second:.9g}", f"{nearest:.9g}")
        raise SystemDescriptionError([Problem(where, text)])
    for instance, size in zip(checked.instances, ticks, strict=True):
        if total % size and not instance.fmu.capabilities.canHandleVariableCommunicationStepSize:
            text = OVERRUN.text(instance.name, f"{size / per_second:.9g}", f"{total / per_second:.9g}")
            problems.append(Problem(instance.where, text))
    problems += _unlike(checked, ticks, per_second)
    if problems:
        raise SystemDescriptionError(problems)
    sources = tuple("--step" if step is not None else one.step_source for one in checked.instances)
    notes = [*_step_notes(checked.instances, sources, step), *_fractions(checked.instances, sizes, step)]
    if base != min(ticks):
        notes.append(
            f"the base step is {base / per_second:.9g} s, that of no instance: rows are recorded where a step ends"
        )
    periods = tuple(size // base for size in ticks)
    return TimeGrid(start * per_ns, base, total // base, periods, tuple(notes), per_ns, sources)


def _step_notes(instances: Sequence[ComponentInstance], sources: Sequence[str], step: float | None) -> list[str]:
    """Returns notes on unexpected origins of step sizes: --step over the system, and proposals of other tools' FMUs."""
    if step is not None:
        over = [one.name for one in instances if one.step_source == "system" and one.step_size != step]
        listed = ", ".join(over[:3]) + (f" and {len(over) - 3} more" if len(over) > 3 else "")
        return [f"--step {step:g}: it takes the place of the step sizes that the system gives {listed}"] if over else []
    proposed = {
        one.fmu.path.name: one.step_size
        for one, source in zip(instances, sources, strict=True)
        if source == "FMU" and one.fmu.generation_tool != "uav-cosim"
    }
    notes = [
        f"{name}: it steps by {size:g} s, which the FMU proposes (DefaultExperiment); --step gives another"
        for name, size in proposed.items()
    ]
    if unnamed := [one.name for one, source in zip(instances, sources, strict=True) if source == "default"]:
        listed = ", ".join(unnamed[:3]) + (f" and {len(unnamed) - 3} more" if len(unnamed) > 3 else "")
        text = f"neither system nor FMU names a step size: {DEFAULT_STEP:g} s are taken, as in OMSimulator"
        notes.append(f"{listed}: {text}; --step gives another")
    return notes


def _fractions(instances: Sequence[ComponentInstance], sizes: Sequence[Fraction], step: float | None) -> list[str]:
    """Adds problems for step sizes that are not whole nanoseconds."""
    shown = {
        size: one.step_size if step is None else step
        for one, size in zip(instances, sizes, strict=True)
        if size.denominator > 1
    }
    return [
        f"step size {given:.17g} s is taken as {size / _NANO} s: time is counted in exact fractions"
        for size, given in shown.items()
        if (size / _NANO).denominator <= _LARGEST_DENOMINATOR
    ]


def _unlike(checked: CheckedSystem, sizes: Sequence[int], per_second: int) -> list[Problem]:
    """Adds problems for instances that are connected by Clocks and have different step sizes."""
    problems = []
    for members in lockstep(checked):
        steps = {sizes[i] for i in members}
        if len(steps) > 1:
            shown = ", ".join(f"{checked.instances[i].name} by {sizes[i] / per_second:.9g} s" for i in members)
            problems.append(Problem(checked.instances[members[0]].where, TIED_STEPS.text(shown)))
    return problems
