"""The start of a run in parts: options that it cannot have, and the execution of each part."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from cosim_master.diagnostics.errors import CosimError, Problem, RunFailed, SystemDescriptionError, Where
from cosim_master.execution.options import RunOptions
from cosim_master.execution.partitions.cut import Cut
from cosim_master.execution.partitions.part import PartExecution, failure_data
from cosim_master.execution.partitions.starting import Disagreed, NotStarted, Refused, Who, agree_to_run, all_ready
from cosim_master.execution.partitions.transport import PartLost, Transport
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.run.opening import Setup
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import Observer, PointObserver

__all__ = ["failing_openly", "periods_of", "refuse_options", "started", "told_others", "told_parts"]

_WORTH_THREADS = 64


def refuse_options(options: RunOptions, *, replayed: bool) -> None:
    """Raises SystemDescriptionError if a run in parts cannot have one of its options.

    Args:
        replayed: whether packets of an earlier run enter.
    """
    refused = {
        "--profile": (options.profile, "the profile of one part tells nothing of the others; profile the system"),
        "--replay": (replayed, "packets enter the parts of a run at the ends of windows only; repeat the run"),
        "--helics": (options.helics is not None, "others would meet parts that have stepped on; run the system"),
    }
    problems = [Problem(Where(name), f"{text} in one process") for name, (given, text) in refused.items() if given]
    if problems:
        raise SystemDescriptionError(problems)


@contextmanager
def failing_openly(transport: Transport) -> Iterator[None]:
    """Tells the other parts of an exception that is a bug or an interruption, so that they do not wait for this one."""
    try:
        yield
    except CosimError:
        raise
    except BaseException as error:
        transport.fail(f"it has failed: {type(error).__name__}: {error}")
        raise


@contextmanager
def told_others(transport: Transport | None) -> Iterator[None]:
    """Tells the other parts, which wait for this one, if an error ends it before all have agreed on the run."""
    try:
        yield
    except (Refused, PartLost, Disagreed):
        raise
    except CosimError as error:
        if transport is not None:
            agree_to_run(transport, error)
        raise


def told_parts(found: Sequence[Mapping[str, Any]], ready: Prepared, cut: Cut) -> Iterator[dict[str, Any]]:
    """Yields the parts for the manifest: who runs what, and where."""
    for part, one in enumerate(found):
        names = [i.name for i, p in zip(ready.checked.instances, cut.of_instance, strict=True) if p == part]
        yield Who(part, str(one["host"]), str(one["processor"]), tuple(names)).as_json()


def started(
    kind: type[PartExecution], transport: Transport, cut: Cut, ready: Prepared, layout: Layout, setup: Setup
) -> PartExecution:
    """Returns the execution of a part, when the instances of all parts have started.

    Raises:
        RunFailed: instances have not started; part 0 has the errors of all parts.
        Refused: instances of another part have not started.
    """
    share = cut.share(transport.part, layout, ready.network)
    if setup.threads is None:
        own = len(ready.checked.instances) - len(share.elsewhere)
        cores = (os.cpu_count() or 1) // transport.here
        setup = replace(setup, threads=max(1, cores) if own >= _WORTH_THREADS else 1)
    try:
        return kind(transport, cut, ready.checked, ready.clock, layout, ready.network, replace(setup, share=share))
    except (PartLost, Refused, NotStarted):
        raise
    except RunFailed as error:
        all_ready(transport, failure_data(error))
        raise


def periods_of(observers: Sequence[Observer]) -> tuple[int, ...]:
    """Returns the base steps between the looks of observers at the values of a run."""
    found: set[int] = set()
    for one in observers:
        if one.every > 0:
            found |= {*one.periods} if isinstance(one, PointObserver) else {one.every}
    return tuple(sorted(found))
