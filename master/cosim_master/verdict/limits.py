"""The limits of distances that a system sets, from its annotation.

<ssc:Annotation type="org.uav-cosim.verdict">
  <verdict xmlns="https://uav-cosim.org/ns/1" contact="0.5" deviation="5"/>
</ssc:Annotation>
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.annotation import root_annotation

__all__ = ["ANNOTATION", "Limits", "limits_of"]

ANNOTATION = "org.uav-cosim.verdict"


@dataclass(frozen=True, slots=True)
class Limits:
    """Distances in m.

    Attributes:
        contact: two vehicles nearer than this touch; 0: they never do.
        deviation: a vehicle farther than this from where its autopilot wants it does not do what it is told; INF: it
            always does.
    """

    contact: float = 0.5
    deviation: float = 5.0


def limits_of(checked: CheckedSystem) -> Limits:
    """The limits that a system sets.

    Raises:
        SystemDescriptionError: the annotation is wrong; all problems at once.
    """
    problems: list[Problem] = []
    reader = root_annotation(checked, ANNOTATION, "verdict", problems)
    standard = Limits()
    limits = Limits(
        contact=reader.number("contact", standard.contact, 0.0, 1e6),
        deviation=reader.number("deviation", standard.deviation, 0.0, math.inf),
    )
    reader.finish()
    reader.children()
    if problems:
        raise SystemDescriptionError(problems)
    return limits
