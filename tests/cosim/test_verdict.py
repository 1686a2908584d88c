"""Verdicts: what a model may declare, and how it stands in the model descriptions."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, ClassVar
from xml.etree.ElementTree import Element, tostring

import pytest

from cosim import Input, Model, Output, PacketInput, Parameter
from cosim.build.description import model_description
from cosim.build.description3 import model_description3
from cosim.build.verdicts import verdicts
from cosim.verdict import Bound, Condition, Formation, Logged, Neighbour, Reason, Role, Rotors, Values, complaints


class Task(IntEnum):
    wait = 1
    fly = 2
    failed = 9


VARIABLES = (
    Input("wind", shape=3, unit="m/s", verdict=Role.OPTIONAL),
    Parameter("sysid", type=int, start=1, verdict=Role.SYSTEM_ID),
    Parameter("stale", unit="s", start=1.0),
    Parameter("begin", unit="s", start=25.0),
    Output(
        "task",
        type=Task,
        start=Task.wait,
        verdict=Condition(
            failed=(Task.failed,), working=(Task.fly,), commanding=(Task.fly,), by="begin", reason="failure"
        ),
    ),
    Output("failure", type=int, verdict=Reason(((1, "it is < too heavy"),))),
    Output("age", unit="s", verdict=Bound(least=0.0, most="stale", of="sysid", text="nobody is heard")),
    Output("error", unit="m", verdict=Bound(most=5.0)),
    Output("place", shape=3, unit="m", verdict=Role.POSITION),
    Parameter("begun", shape=3, unit="m", verdict=Role.START_POSITION),
    Parameter("rests", type=bool),
    Parameter("west", type=int),
    Parameter("gain", start=0.5),
    Output("turn", type=int),
    Output(
        "way",
        unit="m",
        verdict=Formation("turn", "rests", (Neighbour("west", "gain"), Neighbour("west", 0.25)), "begin", "stale"),
    ),
    Output("heading", shape=4, verdict=Role.ATTITUDE),
    Parameter("n", type=int, start=2),
    Parameter("x", shape=2, unit="m"),
    Parameter("turns", shape=2),
    Output("shown", verdict=Logged((("ATT", "heading"), ("RATE", "x")))),
    Output("spin", shape=2, unit="rad/s", verdict=Rotors("n", forward="x", right="x", down="x", direction="turns")),
    Input("kind", type=Task, start=Task.wait, verdict=Values((Task.wait, Task.fly))),
    PacketInput("cable", capacity=300, verdict=Role.SERIAL),
    PacketInput("radio", capacity=300, verdict=Role.TELEMETRY),
)
WRITTEN = [
    '<Optional variable="wind" />',
    '<SystemId variable="sysid" />',
    '<Condition variable="task" failed="9" working="2" commanding="2" by="begin" reason="failure" />',
    '<Reason variable="failure"><Text value="1">it is &lt; too heavy</Text></Reason>',
    '<Bound variable="age" least="0.0" most="stale" of="sysid">nobody is heard</Bound>',
    '<Bound variable="error" most="5.0" />',
    '<Position variable="place" />',
    '<StartPosition variable="begun" />',
    '<Formation variable="way" step="turn" stays="rests" begin="begin" period="stale">'
    '<Neighbour id="west" gain="gain" /><Neighbour id="west" gain="0.25" /></Formation>',
    '<Attitude variable="heading" />',
    '<Logged variable="shown"><Value of="ATT" variable="heading" /><Value of="RATE" variable="x" /></Logged>',
    '<Rotors variable="spin" count="n" forward="x" right="x" down="x" direction="turns" />',
    '<Values variable="kind" values="1 2" />',
    '<Serial variable="cable" />',
    '<Telemetry variable="radio" />',
]


class Judged(Model):
    """Has one verdict of each sort."""

    step_size = 0.1
    variables: ClassVar[Any] = VARIABLES

    def do_step(self, t: float, h: float) -> bool:
        return True


def elements(found: Element | None) -> list[str]:
    assert found is not None
    return [tostring(element, encoding="unicode") for element in found]


def test_verdicts_as_xml() -> None:
    assert elements(verdicts(VARIABLES)) == WRITTEN
    assert verdicts((Output("y"), Input("u"))) is None


def test_fmi_2_has_them_as_a_tool_of_its_own() -> None:
    tools = model_description(Judged, "guid", compiled=False).findall("VendorAnnotations/Tool")
    assert [tool.get("name") for tool in tools] == ["uav-cosim", "org.uav-cosim.verdict"]
    assert [child.tag for child in tools[1]] == ["Verdicts"]  # the schema allows one element below Tool
    assert elements(tools[1][0]) == WRITTEN


def test_fmi_3_has_them_as_an_annotation() -> None:
    root = model_description3(Judged, "token")
    assert root[-1].tag == "Annotations"  # behind ModelStructure, as the schema wants it
    assert root[-1][0].attrib == {"type": "org.uav-cosim.verdict"}
    assert elements(root.find("Annotations/Annotation/Verdicts")) == WRITTEN


@pytest.mark.parametrize(
    ("variable", "complaint"),
    [
        (
            Parameter("y", verdict=Role.OPTIONAL),
            "y: only an input or output can be OPTIONAL, this is of role parameter",
        ),
        (Input("u", shape=3, verdict=Role.POSITION), "u: verdict POSITION is for an output of 3 of kind Real"),
        (Output("y", shape=2, verdict=Role.POSITION), "y: verdict POSITION is for an output of 3 of kind Real"),
        (Output("y", verdict=Role.ARMED), "y: verdict ARMED is for an output of kind Boolean"),
        (
            Output("y", verdict=Condition(failed=(1,))),
            "y: verdict Condition is for an output of kind Enumeration or Integer or Boolean",
        ),
        (
            Output("y", verdict=Bound(most="limit")),
            "y: its verdict refers to limit, but there is no scalar limit of kind Real or Integer",
        ),
        (Output("y", verdict=Logged((("ATT", "z"),))), "y: its verdict refers to z, but there is no such variable"),
        (Input("u", verdict=Logged((("ATT", "u"),))), "u: verdict Logged is for an output"),
        (Output("y", verdict=Role.SERIAL), "y: only a packet port can be SERIAL, this is of kind Real"),
        (
            Parameter("p", verdict=Role.START_POSITION),
            "p: verdict START_POSITION is for an parameter of 3 of kind Real",
        ),
        (Output("y", type=int, verdict=Formation("y")), "y: verdict Formation is for an output of kind Real"),
        (
            Output("y", verdict=Formation("y")),
            "y: its verdict refers to y, but there is no scalar y of kind Integer",
        ),
        (Output("y", shape=3, verdict=Role.ATTITUDE), "y: verdict ATTITUDE is for an output of 4 of kind Real"),
        (
            Output("y", verdict=Rotors("n", "x", "x", "x", "x")),
            "y: verdict Rotors is for an output of kind Real, an array with an element for each rotor",
        ),
        (
            Parameter("p", type=Task, start=Task.wait, verdict=Values((1,))),
            "p: verdict Values is for a scalar input or output of kind Enumeration",
        ),
        (
            Output("y", type=int, verdict=Values((1,))),
            "y: verdict Values is for a scalar input or output of kind Enumeration",
        ),
        (
            Output("y", type=int, verdict=Condition(failed=(1,), by="y")),
            "y: its verdict refers to y, but there is no scalar y of kind Real",
        ),
    ],
)
def test_what_a_verdict_cannot_be_for(variable: Any, complaint: str) -> None:
    assert complaints([variable]) == [complaint]
    with pytest.raises(ValueError, match=r"Wrong\."):
        type("Wrong", (Model,), {"variables": (variable,), "__doc__": "Wrong."})
