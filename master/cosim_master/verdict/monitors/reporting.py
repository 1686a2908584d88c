"""The violations of monitors as findings of the verdict, and in the manifest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from cosim_master.verdict.findings import Finding, Number
from cosim_master.verdict.monitors.monitoring import Monitoring
from cosim_master.verdict.monitors.rules import Rule
from cosim_master.verdict.monitors.violations import Subject

__all__ = ["findings", "in_manifest"]

_KINDS = {"age": "packet age"}
"""Names of kinds of monitors in findings, if they differ from those of the elements."""


def findings(monitoring: Monitoring) -> Iterator[Finding]:
    """Yields a finding for each monitor and subject with violations."""
    for rule in monitoring.rules:
        for subject, one in sorted(rule.violations.subjects.items()):
            yield _finding(rule, subject, one, monitoring.end)


def _finding(rule: Rule, subject: int, one: Subject, end: float) -> Finding:
    monitor = rule.monitor
    total = rule.violations.lasting(subject, min(end, monitor.stop))
    text = f"{monitor.name}: {rule.told(subject, one.worst)} at {one.worst_time:.1f} s"
    if one.count == 1 and subject in rule.violations.open:
        text += f"; violated from {one.first:.1f} s on"
    elif one.count == 1:
        text += f"; violated for {total:.3g} s from {one.first:.1f} s on"
    else:
        text += f"; violated {one.count} times, for {total:.3g} s in all, first at {one.first:.1f} s"
    if monitor.ends:
        text += ", which ends the run"
    numbers: dict[str, Number] = {
        "monitor": monitor.name,
        "worst": _number(one.worst),
        "worst at": one.worst_time,
        "violations": one.count,
        "total": total,
    }
    kind = f"{_KINDS.get(monitor.kind, monitor.kind)} violated"
    return Finding(kind, monitor.severity, rule.who(subject), text, one.first, numbers)


def _number(value: float) -> Number:
    """Returns a number for JSON, which has neither infinity nor NaN."""
    return value if math.isfinite(value) else "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"


def in_manifest(monitoring: Monitoring) -> tuple[dict[str, Any], ...]:
    """Returns each monitor and its violations in the order of time, as plain values for manifest.json."""
    return tuple(
        {
            "name": rule.monitor.name,
            "kind": rule.monitor.kind,
            "severity": rule.monitor.severity,
            "end": rule.monitor.ends,
            "count": rule.violations.count,
            "violations": [
                {
                    "who": list(rule.who(one.subject)),
                    "begin": one.begin,
                    "end": one.end,
                    "worst": _number(one.worst),
                    "worst at": one.worst_time,
                    "cause": rule.told(one.subject, one.worst),
                }
                for one in sorted(rule.violations.kept, key=lambda one: (one.begin, one.subject))
            ],
        }
        for rule in monitoring.rules
    )
