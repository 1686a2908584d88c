"""One run of a study in a worker: from values and seed to a row of the dataset."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.campaigns.metrics.built_in import players_of
from cosim_master.campaigns.metrics.measured import Collector, Measured
from cosim_master.campaigns.metrics.metric import MetricError, finite
from cosim_master.campaigns.running.options import options_of
from cosim_master.campaigns.running.place import Disagreement, Place, agree, here
from cosim_master.campaigns.running.prefix import Prefix, unpacked
from cosim_master.campaigns.study.study import Planned, Study
from cosim_master.diagnostics.errors import CosimError
from cosim_master.diagnostics.names import matching
from cosim_master.execution.options import Listener
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.results.storage.arrays import array_of
from cosim_master.stepping.observation import View

__all__ = ["BAD", "CRASHED", "REFUSED", "Ended", "perform", "row_without_run"]

FAILED, REFUSED, CRASHED = "failed", "refused", "crashed"
BAD = (FAILED, REFUSED, CRASHED)
"""Outcomes of runs without a result: their beginning failed, a value was wrong, or the process of the worker ended."""
_ONE_AT_A_TIME = threading.Lock()
"""Workers of other schedulers may have several threads; FMUs of one process share it."""
_TEXT = 2000
"""Characters of a reason."""


@dataclass(frozen=True, slots=True)
class Ended:
    """A run that has ended: its row, the signals kept (a Parquet file, or empty), and the process that made it."""

    row: Mapping[str, Any]
    signals: bytes
    worker: str


def perform(study: Study, place: Place, run: Planned, prefix: Prefix | str | None = None) -> Ended:
    """Makes a run, and returns its row; a run that fails has one, too.

    Args:
        place: the study as its client has checked it.
        prefix: the beginning of the run, or the reason why it failed; None: it is simulated from its start.

    Raises:
        Disagreement: this process has another system, other FMUs or another version than the client.
    """
    if isinstance(prefix, str):
        return Ended(row_without_run(study, place, run, FAILED, prefix), b"", here())
    with _ONE_AT_A_TIME:
        return _performed(study, place, run, prefix)


def _performed(study: Study, place: Place, run: Planned, prefix: Prefix | None) -> Ended:
    kept: list[Prepared] = []
    collected: list[Collector] = []

    def prepared(ready: Prepared) -> None:
        agree(place, ready)
        kept.append(ready)

    def collector(view: View) -> Collector:
        collected.append(Collector(view))
        return collected[0]

    observers = [collector] if place.measured else []
    try:
        with unpacked(prefix) as origin:
            options = options_of(study, place, run, origin=origin)
            result = simulate(study.system, options, observers=observers, listener=Listener(prepared=prepared))
    except Disagreement:
        raise
    except CosimError as error:
        return Ended(row_without_run(study, place, run, REFUSED, str(error)), b"", here())
    if collected and prefix is not None and prefix.rows is not None:
        collected[0].begin(prefix.rows)
    if prefix is not None:
        result = replace(result, simulated_s=result.simulated_s + prefix.time - kept[0].clock.time(0))
    measured = _measured(kept[0], collected[0] if collected else None, result)
    return Ended(_row(study, place, run, measured), _signals(study.keep, measured), here())


def _measured(ready: Prepared, collector: Collector | None, result: RunResult) -> Measured:
    changed: dict[str, dict[str, Any]] = {}
    for change in ready.changes:
        name = ready.checked.instances[change.instance].name
        changed.setdefault(name, {})[change.variable.name] = change.value
    players = players_of(ready.checked, changed)
    if collector is None:
        return Measured(np.zeros(0), {}, {}, result, players)
    return Measured(collector.time, collector.signals(), collector.units, result, players, collector.outputs)


def _row(study: Study, place: Place, run: Planned, measured: Measured) -> dict[str, Any]:
    result = measured.result
    reasons = [] if result.error is None else [str(result.error)]
    metrics: dict[str, float | None] = {}
    for metric in study.metrics:
        try:
            metrics[metric.name] = finite(metric.value(measured))
            if metrics[metric.name] is None:
                reasons.append(f"metric {metric.name}: it is no finite number in this run")
        except MetricError as error:
            metrics[metric.name] = None
            reasons.append(str(error))
    verdict = result.verdict
    found = verdict.findings if verdict is not None else ()
    told = [one for one in found if one.severity != "note"]
    return {
        **_head(study, place, run),
        "outcome": str(result.outcome),
        "reason": "\n".join(reasons)[:_TEXT],
        "good": result.outcome == "done" and verdict is not None and verdict.good,
        "failures": sum(one.severity == "failure" for one in found),
        "warnings": sum(one.severity == "warning" for one in found),
        "findings": "; ".join(dict.fromkeys(f"{one.kind}: {', '.join(one.who[:3])}" for one in told))[:_TEXT],
        "simulated_s": result.simulated_s,
        **metrics,
    }


def row_without_run(study: Study, place: Place, run: Planned, outcome: str, reason: str) -> dict[str, Any]:
    """Returns the row of a run that has no result."""
    return {**_head(study, place, run), "outcome": outcome, "reason": reason[:_TEXT], "good": False}


def _head(study: Study, place: Place, run: Planned) -> dict[str, Any]:
    """Returns the columns that are known before a run."""
    texts = {one.label: run.values[one.label] for one in study.factors}
    values = {one.label: float(texts[one.label]) if one.numeric else texts[one.label] for one in study.factors}
    return {"run": run.run, "point": run.point, "seed": place.seed if run.seed is None else run.seed, **values}


def _signals(keep: Sequence[str], measured: Measured) -> bytes:
    """Returns the signals to be kept as a Parquet file; empty if there are none."""
    names = list(dict.fromkeys(name for pattern in keep for name in matching(pattern, measured.signals)))
    if not names:
        return b""
    columns = [
        array_of(values, pa.float64()) for values in (measured.time, *(measured.signals[name] for name in names))
    ]
    written = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_arrays(columns, ["time", *names]), written, compression="zstd")
    return bytes(written.getvalue().to_pybytes())
