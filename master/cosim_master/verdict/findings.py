"""Findings about a swarm, and the judgement that collects the findings about one run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

__all__ = ["Finding", "Judgement", "Number", "Severity"]

Severity = Literal["failure", "warning", "note"]
"""A failure: the swarm did not perform its task. A warning: a possible cause, or doubtful. A note: nothing is wrong if
it is intended.
"""
Number = float | int | str
_ORDER: tuple[Severity, ...] = ("failure", "warning", "note")


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding about a swarm.

    Attributes:
        kind: a word of docs/verdict.md ("agent failed", "contact", ...).
        severity: failure, warning or note.
        who: hierarchical names of the instances, nodes or variables concerned.
        text: the problem and possible remedies, for people.
        time: time of its first occurrence, s; None if it was known before the run.
        numbers: measured values, by name; SI.
    """

    kind: str
    severity: Severity
    who: tuple[str, ...]
    text: str
    time: float | None = None
    numbers: Mapping[str, Number] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            "severity": self.severity,
            "who": list(self.who),
            "time": self.time,
            "text": self.text,
            "numbers": dict(self.numbers),
        }


@dataclass(frozen=True, slots=True)
class Judgement:
    """The findings about a run.

    Attributes:
        findings: failures first, then warnings, then notes; each group in the order of time and names.
        begin, end: the part of the run that was watched, s.
        nearest: the closest approach of two vehicles: "who", "distance" [m] and "time" [s]; empty if there are fewer
            than two vehicles.
        monitors: each monitor of the system and its violations, see `monitors.reporting.in_manifest`.
    """

    findings: tuple[Finding, ...] = ()
    begin: float = 0.0
    end: float = 0.0
    nearest: Mapping[str, Any] = field(default_factory=dict)
    monitors: tuple[Mapping[str, Any], ...] = ()

    @classmethod
    def of(
        cls,
        found: Sequence[Finding],
        begin: float,
        end: float,
        nearest: Mapping[str, Any] | None = None,
        monitors: tuple[Mapping[str, Any], ...] = (),
    ) -> Judgement:
        """Returns the judgement with its findings in order."""
        key = {id(one): n for n, one in enumerate(found)}
        in_order = sorted(
            found, key=lambda f: (_ORDER.index(f.severity), -1.0 if f.time is None else f.time, key[id(f)])
        )
        return cls(tuple(in_order), begin, end, nearest or {}, monitors)

    @property
    def good(self) -> bool:
        """True if there are neither failures nor warnings."""
        return all(finding.severity == "note" for finding in self.findings)

    def as_json(self, *, failed: bool = False) -> dict[str, Any]:
        """Returns the judgement for manifest.json (docs/verdict.md); a run that has failed is not good."""
        counts = Counter(finding.severity for finding in self.findings)
        return {
            "good": self.good and not failed,
            "from": self.begin,
            "to": self.end,
            "failures": counts["failure"],
            "warnings": counts["warning"],
            "notes": counts["note"],
            "nearest": dict(self.nearest) or None,
            "findings": [finding.as_json() for finding in self.findings],
            **({"monitors": [dict(one) for one in self.monitors]} if self.monitors else {}),
        }
