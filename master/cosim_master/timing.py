"""The clock of a run: whole nanoseconds, a base step, and each instance's period in base steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cosim_master.check import CheckedSystem
from cosim_master.clocks import lockstep
from cosim_master.errors import Problem, SystemDescriptionError
from cosim_master.limitations import BASE_STEP, NANOSECONDS, OVERRUN, TIED_STEPS, WHOLE_TIMES

__all__ = ["Timing", "timing"]

_NANO = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Timing:
    """The clock of a run in ns: start, base step, number of base steps, and each instance's period in base steps."""

    start: int
    base: int
    steps: int
    periods: tuple[int, ...]
    notes: tuple[str, ...] = ()


def _ticks(seconds: float) -> int | None:
    """Nanoseconds of a time in s, None if it is not a whole number of them."""
    if not math.isfinite(seconds):
        return None
    ticks = round(seconds * _NANO)
    return ticks if math.isclose(ticks, seconds * _NANO, rel_tol=1e-12, abs_tol=1e-4) else None


def timing(checked: CheckedSystem, until: float | None = None, step: float | None = None) -> Timing:
    """Choose the clock.

    Args:
        until: stop time in s; the system's DefaultExperiment where None.
        step: step size in s of instances for which neither system nor FMU names one.

    Raises:
        SystemDescriptionError: no stop time, no step size, times that are no multiples of a nanosecond, or a run
            whose end an FMU with a fixed step size would overrun.
    """
    problems: list[Problem] = []
    where = checked.structure.where
    stop = until if until is not None else checked.stop_time
    start_ticks = _ticks(checked.start_time)
    stop_ticks = None if stop is None else _ticks(stop)
    if stop is None:
        problems.append(Problem(where, "no stop time: give one with --until, or a DefaultExperiment in the system"))
    elif stop <= checked.start_time:
        problems.append(Problem(where, f"stop time {stop:g} s does not lie behind start time {checked.start_time:g} s"))
    if start_ticks is None or (stop is not None and stop_ticks is None):
        problems.append(Problem(where, WHOLE_TIMES.text()))
    sizes: list[int] = []
    for instance in checked.instances:
        size = instance.step_size if instance.step_size is not None else step
        ticks = None if size is None else _ticks(size)
        if size is None:
            text = f"{instance.name}: no step size: neither the system nor the FMU names one; give one with --step"
            problems.append(Problem(instance.where, text))
        elif ticks is None or ticks <= 0:
            problems.append(Problem(instance.where, NANOSECONDS.text(instance.name, size)))
        else:
            sizes.append(ticks)
    if problems:
        raise SystemDescriptionError(problems)
    assert start_ticks is not None and stop_ticks is not None
    if not checked.instances:
        return Timing(start_ticks, stop_ticks - start_ticks, 1, ())
    base = math.gcd(*sizes)
    total = stop_ticks - start_ticks
    if total % base:
        nearest = (total // base + 1) * base / _NANO + checked.start_time
        text = BASE_STEP.text(f"{total / _NANO:g}", f"{base / _NANO:g}", f"{nearest:g}")
        raise SystemDescriptionError([Problem(where, text)])
    steps = total // base
    for instance, size in zip(checked.instances, sizes, strict=True):
        if total % size and not instance.fmu.capabilities.canHandleVariableCommunicationStepSize:
            text = OVERRUN.text(instance.name, f"{size / _NANO:g}", f"{total / _NANO:g}")
            problems.append(Problem(instance.where, text))
    problems += _unlike(checked, sizes)
    if problems:
        raise SystemDescriptionError(problems)
    notes = () if base == min(sizes) else (f"the base step is {base / _NANO:g} s, that of no instance",)
    return Timing(start_ticks, base, steps, tuple(size // base for size in sizes), notes)


def _unlike(checked: CheckedSystem, sizes: Sequence[int]) -> list[Problem]:
    """Instances that are tied together by Clocks and have different step sizes."""
    problems = []
    for members in lockstep(checked):
        steps = {sizes[i] for i in members}
        if len(steps) > 1:
            shown = ", ".join(f"{checked.instances[i].name} by {sizes[i] / _NANO:g} s" for i in members)
            problems.append(Problem(checked.instances[members[0]].where, TIED_STEPS.text(shown)))
    return problems
