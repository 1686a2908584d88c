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
        contact: two vehicles closer than this are in contact; 0 turns the check off.
        deviation: a vehicle farther than this from its desired position does not follow its autopilot; INF turns the
            check off.
    """

    contact: float = 0.5
    deviation: float = 5.0


def limits_of(checked: CheckedSystem) -> Limits:
    """Returns the limits that a system sets.

    Raises:
        SystemDescriptionError: the annotation is invalid; all problems are reported at once.
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
