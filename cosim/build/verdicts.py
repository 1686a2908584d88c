"""XML of a model's verdicts, the same for FMI 2 and 3: one element <Verdicts> with a child for each variable.

    <Verdicts>
      <Position variable="position"/>
      <OnGround variable="on_ground"/>
      <Condition variable="state" failed="9" working="8" commanding="5 6 7 8" by="first_step_time" reason="failure"/>
      <Reason variable="failure"><Text value="5">its autopilot has not armed</Text></Reason>
      <Bound variable="left_age" least="0.0" most="stale_time" of="left_sysid">its left neighbour is not heard</Bound>
      <Formation variable="target" step="step" stays="stubborn" begin="first_step_time" period="period">
        <Neighbour id="left_sysid" gain="epsilon"/>
      </Formation>
      <Rotors variable="speed" count="n" forward="x" right="y" down="z" direction="turns"/>
      <Logged variable="mode"><Value of="ATT.Des" variable="attitude_target"/></Logged>
      <Values variable="airframe" values="1 2 3"/>
      <Optional variable="wind"/>
      <Telemetry variable="telemetry_rx"/>
    </Verdicts>

Arrays are named as declared, also in FMI 2, where their elements are separate variables `position[1]`, ....
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from xml.etree.ElementTree import Element, SubElement

from cosim.model import Variable
from cosim.verdict import Bound, Condition, Formation, Logged, Reason, Role, Rotors, Values, Verdict

__all__ = ["verdicts"]


def verdicts(variables: Sequence[Variable]) -> Element | None:
    """Returns the element with all verdicts of a declaration, or None if there are none."""
    judged = [(v.name, v.verdict) for v in variables if v.verdict is not None]
    if not judged:
        return None
    root = Element("Verdicts")
    for name, verdict in judged:
        root.append(_element(name, verdict))
    return root


def _element(name: str, verdict: Verdict) -> Element:
    if isinstance(verdict, Role):
        return Element(verdict.value, variable=name)
    element = Element(type(verdict).__name__, variable=name)
    if isinstance(verdict, Condition):
        for what in ("failed", "working", "commanding"):
            if values := getattr(verdict, what):
                element.set(what, " ".join(str(int(value)) for value in values))
        for what in ("by", "reason"):
            if other := getattr(verdict, what):
                element.set(what, other)
    elif isinstance(verdict, Values):
        element.set("values", " ".join(str(int(value)) for value in verdict.values))
    elif isinstance(verdict, Reason):
        for value, text in verdict.texts:
            SubElement(element, "Text", value=str(int(value))).text = text
    elif isinstance(verdict, Bound):
        if not math.isinf(verdict.least):
            element.set("least", repr(float(verdict.least)))
        if isinstance(verdict.most, str):
            element.set("most", verdict.most)
        elif not math.isinf(verdict.most):
            element.set("most", repr(float(verdict.most)))
        if verdict.of:
            element.set("of", verdict.of)
        element.text = verdict.text or None
    elif isinstance(verdict, Rotors):
        for name_of, other in asdict(verdict).items():
            element.set(name_of, other)
    elif isinstance(verdict, Logged):
        for place, variable in verdict.variables:
            SubElement(element, "Value", of=place, variable=variable)
    elif isinstance(verdict, Formation):
        for what in ("step", "stays", "begin", "period"):
            if other := getattr(verdict, what):
                element.set(what, other)
        for neighbour in verdict.neighbours:
            gain = neighbour.gain if isinstance(neighbour.gain, str) else repr(float(neighbour.gain))
            SubElement(element, "Neighbour", id=neighbour.id, gain=gain)
    return element
