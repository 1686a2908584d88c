"""Declarations, records, and the interpreted slave as pythonfmu's wrapper calls it."""

from __future__ import annotations

import base64
import json
import math
import re
from enum import IntEnum
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pythonfmu.enums import Fmi2Status

from cosim import Input, Memory, Model, Output, PacketInput, PacketOutput, Parameter, State, kernel
from cosim.model import busy_part, flat_variables, record_layout


class Colour(IntEnum):
    red = 3
    green = 1


class Empty(IntEnum):
    pass


@kernel
def begin(m: Any) -> int:
    return 0


@kernel
def go_on(m: Any, t: float, h: float) -> int:
    return 0


def declare(**attributes: Any) -> type[Model]:
    return type("Declared", (Model,), attributes)


# -- declarations ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Input("two words"),
            r"variable 'two words': a name must be an ASCII Python identifier other than a keyword",
        ),
        (lambda: Input("x 1"), r"'x 1': a name must be"),
        (
            lambda: Output("x[1]"),
            r'x\[1\]: declare the whole array with shape=, as in Output\("x", shape=3\)',
        ),
        (lambda: Input("x[7]"), r'as in Input\("x", shape=7\)'),
        (lambda: Input("größe"), r"ASCII"),
        (lambda: Output("lambda"), r"'lambda': a name must be .* other than a keyword"),
        (lambda: State("shape"), r"variable shape: numpy records have an attribute of this name"),
        (lambda: State("data"), r"variable data: numpy records"),
        (lambda: Input("x", shape=0), r"variable x: shape \(0,\); a variable is a scalar or has a length of 1 or more"),
        (lambda: Input("x", shape=-2), r"shape \(-2,\)"),
        (lambda: Input("x", shape=(2, 3)), r"shape \(\(2, 3\),\)"),
        (lambda: Memory("x", shape=(2, 0)), r"shape \(2, 0\)"),
        (lambda: Memory("x", shape=4.0), r"variable x: shape 4.0; it is an int of 1 or more, or a tuple of such"),
        (lambda: Memory("x", shape="4"), r"variable x: shape '4'; it is an int of 1 or more, or a tuple of such"),
        (lambda: Memory("x", shape=[4, 2.0]), r"variable x: shape \(4, 2.0\); it is an int of 1 or more"),
        (lambda: Memory("x", dtype="O"), r"variable x: dtype 'O'; there are f8, f4, i8"),
        (lambda: Memory("x", dtype="?", shape=3), r"array of dtype '\?'; .* use 'u1'"),
        (lambda: Input("x", start=(1.0, 2.0)), r"variable x: 2 start values for shape \(\)"),
        (lambda: Input("x", shape=3, start=(1.0, 2.0)), r"variable x: 2 start values for shape \(3,\)"),
        (lambda: Input("x", start="1"), r"variable x: start '1' is not a float"),
        (lambda: Input("x", start=True), r"variable x: start True is not a float"),
        (lambda: Input("x", shape=2, start=(1.0, math.nan)), r"start nan is not within -inf to inf"),
        (lambda: Input("x", type=int, start=1.5), r"start 1.5 is not an int of 32 bits"),
        (lambda: Input("x", type=int, start=2**31), r"start 2147483648 is not an int of 32 bits"),
        (lambda: Input("x", type=bool, start=1), r"start 1 is not a bool"),
        (lambda: Input("x", type=str, start=1), r"start 1 is not a str"),
        (lambda: Input("x", type=Colour, start=2), r"variable x: start 2 is not one of red, green"),
        (lambda: Input("x", type=str, shape=2), r"variable x: String variables are scalars"),
        (lambda: Input("x", type=int, unit="m"), r"variable x: unit m; only variables of type float have a unit"),
        (lambda: Parameter("x", minimum=2.0, maximum=1.0), r"minimum 2.0 and maximum 1.0 exclude every value"),
        (lambda: Parameter("x", minimum=math.nan), r"minimum nan and maximum None exclude every value"),
        (lambda: Parameter("x", start=3.0, minimum=0.0, maximum=2.0), r"start 3.0 is not within 0 to 2"),
        (lambda: Parameter("x", start=0.0, minimum=1.0), r"start 0.0 is not within 1 to inf"),
        (lambda: Parameter("x", type=bool, minimum=0.0), r"only variables of type float and int have a minimum"),
        (lambda: PacketInput("rx", capacity=0), r"variable rx: capacity 0; it is 1 byte or more"),
    ],
)
def test_misuse_of_a_variable(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("of", [complex, list, Empty, IntEnum, "float", np.float64, None])
def test_misuse_of_a_type(of: Any) -> None:
    with pytest.raises(TypeError, match="a variable is float, int, bool, str or an IntEnum with members"):
        Input("x", type=of)


@pytest.mark.parametrize(
    ("attributes", "kind", "message"),
    [
        (
            {"variables": (Memory("x"), Output("x"))},
            ValueError,
            "model Declared declares x twice, as memory and as output; those of a kit count too, so give yours another",
        ),
        (
            {"variables": (PacketInput("rx", capacity=1), Input("rx_len"))},
            ValueError,
            "declares rx_len twice, as input and as the field rx_len of packets; those of a kit",
        ),
        (
            {"variables": (Input("u"), Parameter("p"), Output("y", depends=("u", "p", "q")))},
            ValueError,
            "Declared.y depends on p, q; valid inputs: u",
        ),
        ({"variables": (Output("y", depends=("u",)),)}, ValueError, "y depends on u; valid inputs: none"),
        (
            {"variables": (Input("s", type=str),), "kernels": (begin, go_on)},
            ValueError,
            "Declared.s: a model with kernels has no String variables",
        ),
        ({"kernels": (go_on, begin)}, TypeError, r"kernels must be \(start, advance\), the functions start\(m\)"),
        ({"kernels": (begin,)}, TypeError, r"kernels must be \(start, advance\)"),
        ({"kernels": (begin, "advance")}, TypeError, r"kernels must be \(start, advance\)"),
        ({"errors": {0: "fine"}}, ValueError, "errors has 0: 'fine'; it maps integers other than 0 to messages"),
        ({"errors": {"1": "text"}}, ValueError, "errors has '1'"),
        ({"errors": {2**31: "large"}}, ValueError, "errors has 2147483648"),
        ({"errors": {1: 2}}, ValueError, "errors has 1: 2"),
    ],
)
def test_misuse_of_a_model(attributes: dict[str, Any], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        declare(**attributes)


def test_the_shape_of_a_memory_may_be_a_list() -> None:
    model = declare(variables=(Memory("table", shape=[4, 2]),))
    assert model.variables == (Memory("table", shape=(4, 2)),)
    assert model.record().table.shape == (4, 2)


def test_a_model_needs_an_ascii_name() -> None:
    with pytest.raises(ValueError, match="model Größe: its name becomes a C identifier and must be ASCII"):
        type("Größe", (Model,), {})


def test_flat_variables_number_arrays_from_one() -> None:
    variables = (
        Memory("hidden", shape=4),
        Input("u", shape=2, start=(3.0, 4.0)),
        Output("n", type=int, shape=2, start=7),
    )
    flat = [(one.name, one.index, one.start) for one in flat_variables(variables)]
    assert flat == [("u[1]", 0, 3.0), ("u[2]", 1, 4.0), ("n[1]", 0, 7), ("n[2]", 1, 7)]


# -- records --------------------------------------------------------------------------------------------------------


def test_the_head_of_a_record_is_what_the_environment_sets() -> None:
    variables = (
        Output("late", type=bool),
        Parameter("p"),
        State("x", shape=2),
        PacketInput("rx", capacity=5),
        Memory("table", dtype="i2", shape=(2, 3)),
        Memory("bytes", dtype="u1", shape=7),
        Memory("large", dtype="f8", shape=(8, 16)),
        Input("flag", type=bool),
        Input("marks", type=bool, shape=3),
        Input("number", type=int),
        PacketOutput("tx", capacity=3),
    )
    dtype, head = record_layout(variables)
    assert dtype.fields is not None
    offsets = {name: (str(field[0]), field[1]) for name, field in dtype.fields.items()}
    assert offsets == {
        "rx": ("('u1', (5,))", 0),
        "rx_len": ("int32", 8),
        "p": ("float64", 16),
        "flag": ("bool", 24),
        "marks": ("('u1', (3,))", 25),
        "number": ("int32", 28),
        "tx_len": ("int32", 32),
        "late": ("bool", 36),
        "x": ("('<f8', (2,))", 40),
        "table": ("('<i2', (2, 3))", 56),
        "bytes": ("('u1', (7,))", 68),
        "large": ("('<f8', (8, 16))", 80),
        "tx": ("('u1', (3,))", 1104),
    }
    assert (head, dtype.itemsize) == (32, 1112)
    assert busy_part(variables) == (8, 68)


def test_a_record_that_is_all_head_and_one_without_fields() -> None:
    dtype, head = record_layout((Input("u"),))
    assert (head, dtype.itemsize) == (8, 8)
    dtype, head = record_layout((Input("text", type=str),))
    assert (head, dtype.itemsize) == (1, 1)


def test_record_holds_the_start_values(samples: SimpleNamespace) -> None:
    m = samples.Plant.record()
    assert (m.u, m.count, bool(m.enable), m.gear, m.x, m.steps) == (0.5, 2, True, 2, 10.0, 0)
    assert list(m.w) == [1.0, 2.0, 3.0]
    assert list(m.names) == [1, 0]
    assert m.history.shape == (2, 3)
    assert not m.history.any()
    assert (m.rx_len, len(m.rx), m.tx_len, len(m.tx), m.engaged) == (0, 10, 0, 13, 1)
    m.u = 7.0
    assert samples.Plant.record().u == 0.5


@pytest.mark.parametrize("plain", [False, True])
def test_kernels_on_a_record(samples: SimpleNamespace, plain: bool) -> None:
    start, advance = (getattr(k, "py_func", k) if plain else k for k in samples.Plant.kernels)
    m = samples.Plant.record()
    assert start(m) == 0
    assert (m.steps, m.y, list(m.z), m.total, bool(m.ready), m.engaged) == (1, 11.0, [3.0, 3.0], 200, True, 2)
    m.rx[:3] = (1, 2, 3)
    m.rx_len = 3
    assert advance(m, 0.25, 0.5) == 0
    assert (m.steps, m.x, m.y, m.history[1, 2]) == (2, 10.5, 11.5, 0.75)
    assert (m.tx_len, bytes(m.tx[:4])) == (4, b"\x03\x02\x01\x02")
    m.fault = 2
    assert advance(m, 0.25, 0.5) == 7


# -- the slave ------------------------------------------------------------------------------------------------------

NAMES = [
    "y", "u", "w[1]", "w[2]", "w[3]", "count", "enable", "gear", "rx", "x", "steps", "gain", "trim", "limit", "fault",
    "names[1]", "names[2]", "z[1]", "z[2]", "total", "ready", "engaged", "tx",
]  # fmt: skip
VR = {name: i for i, name in enumerate(NAMES)}


@pytest.fixture
def slave(samples: SimpleNamespace) -> Any:
    return samples.Plant(instance_name="plant")


def real(slave: Any, *names: str) -> list[float]:
    return slave.get_real([VR[name] for name in names])


def initialised(slave: Any) -> Any:
    slave.setup_experiment(0.0, None, None)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    return slave


def test_names_are_value_references(samples: SimpleNamespace, slave: Any) -> None:
    assert [one.name for one in flat_variables(samples.Plant.variables)] == NAMES
    assert [(v.name, v.value_reference) for v in slave.vars.values()] == list(zip(NAMES, range(23), strict=True))


def test_start_runs_once_after_each_change(slave: Any) -> None:
    calls = []
    start, advance = type(slave).kernels
    slave.kernels_seen = calls
    spied = type(
        "Spied", (type(slave),), {"kernels": (lambda m: calls.append(1) or start(m), lambda m, t, h: advance(m, t, h))}
    )(instance_name="spied")
    spied.enter_initialization_mode()
    assert calls == []
    assert real(spied, "y", "x") == [11.0, 10.0]
    assert real(spied, "z[1]", "z[2]") == [3.0, 3.0]
    assert len(calls) == 1
    spied.set_real([VR["u"], VR["gain"]], [1.0, 3.0])
    spied.set_integer([VR["count"], VR["gear"]], [5, 3])
    assert len(calls) == 1
    assert real(spied, "y") == [13.0]
    assert spied.get_integer([VR["steps"], VR["total"], VR["engaged"]]) == [1, 500, 3]
    assert len(calls) == 2
    spied.exit_initialization_mode()
    assert len(calls) == 2
    spied.set_real([VR["u"]], [2.0])
    assert real(spied, "y") == [13.0]
    assert len(calls) == 2


def test_initialization_without_a_get_runs_start_too(slave: Any) -> None:
    initialised(slave)
    assert slave.get_integer([VR["steps"]]) == [1]
    assert slave.m.history[1, 2] == 0.5


def test_steps_by_hand(slave: Any) -> None:
    initialised(slave)
    slave.set_real([VR["u"]], [0.25])
    slave.set_string([VR["rx"]], [base64.b64encode(b"\x00\xffA").decode()])
    assert slave.do_step(0.0, 0.5) is True
    assert real(slave, "x", "y") == [10.25, 10.75]
    assert slave.get_string([VR["tx"]]) == [base64.b64encode(b"A\xff\x00\x02").decode()]
    slave.set_string([VR["rx"]], [""])
    assert slave.do_step(0.5, 0.5) is True
    assert real(slave, "x", "y") == [10.5, 11.0]
    assert slave.get_string([VR["rx"], VR["tx"]]) == ["", base64.b64encode(b"\x03").decode()]


def test_booleans_and_arrays_of_them(slave: Any) -> None:
    initialised(slave)
    slave.set_boolean([VR["enable"]], [False])
    slave.do_step(0.0, 1.0)
    assert slave.get_boolean([VR["ready"], VR["names[1]"], VR["names[2]"]]) == [False, True, False]


def test_what_cannot_be_set(slave: Any) -> None:
    for name in ("y", "x", "z[2]"):
        with pytest.raises(ValueError, match=r"is calculated by the FMU \((state|output)\) and cannot be set"):
            slave.set_real([VR[name]], [1.0])
    initialised(slave)
    slave.set_real([VR["trim"]], [0.5])
    with pytest.raises(ValueError, match="gain is a fixed parameter: it cannot be set after initialization"):
        slave.set_real([VR["gain"]], [1.0])
    slave.do_step(0.0, 0.5)
    assert real(slave, "x") == [11.0]


@pytest.mark.parametrize(
    ("call", "name", "value", "message"),
    [
        ("set_real", "gain", 10.5, "gain = 10.5 is not within 0 to 10"),
        ("set_real", "u", math.nan, "u = nan is not within -inf to inf"),
        ("set_integer", "limit", 0, "limit = 0 is not within 1 to 1000"),
        ("set_integer", "gear", 4, "gear = 4 is not within 1 to 3"),
        ("set_string", "rx", "A", "rx: not base64 text"),
        ("set_string", "rx", "AA=A", "rx: not base64 text"),
        ("set_string", "rx", "A A=", "rx: not base64 text"),
        ("set_string", "rx", "ü", "rx: not base64 text"),
        ("set_string", "rx", base64.b64encode(bytes(11)).decode(), "rx holds 10 bytes, not 11"),
    ],
)
def test_values_that_are_refused(slave: Any, call: str, name: str, value: Any, message: str) -> None:
    before = bytes(slave._bytes)
    with pytest.raises(ValueError, match=message):
        getattr(slave, call)([VR[name]], [value])
    assert bytes(slave._bytes) == before


@pytest.mark.parametrize(("used", "told"), [(-1, "a packet does not fit into its 13 bytes"), (14, "reports 14 bytes")])
def test_packets_that_cannot_have_been_written(slave: Any, used: int, told: str) -> None:
    initialised(slave)
    slave.m.tx_len = used
    with pytest.raises(ValueError, match=f"^tx: .*{told}"):
        slave.get_string([VR["tx"]])


@pytest.mark.parametrize("vr", [-1, 23, 10**6])
@pytest.mark.parametrize("kind", ["real", "integer", "boolean", "string"])
def test_value_references_out_of_range(slave: Any, vr: int, kind: str) -> None:
    with pytest.raises(ValueError, match=f"value reference {vr}: Plant has 0 to 22"):
        getattr(slave, f"get_{kind}")([vr])
    with pytest.raises(ValueError, match=f"value reference {vr}: Plant has 0 to 22"):
        getattr(slave, f"set_{kind}")([vr], ["" if kind == "string" else 0])


def test_value_references_of_another_type(slave: Any) -> None:
    kinds = {"real": "u", "integer": "count", "boolean": "enable", "string": "rx"}
    for kind in kinds:
        for other, name in kinds.items():
            if other != kind:
                with pytest.raises(TypeError, match=f"value reference {VR[name]} is {name}, a .*, not "):
                    getattr(slave, f"get_{kind}")([VR[name]])
                with pytest.raises(TypeError, match=f"value reference {VR[name]} is {name}, a .*, not "):
                    getattr(slave, f"set_{kind}")([VR[name]], ["" if kind == "string" else 1])


def test_state_round_trip_through_json(slave: Any) -> None:
    initialised(slave)
    slave.do_step(0.0, 0.125)
    saved = slave._fmu_state_to_bytes(slave._get_fmu_state())
    assert json.loads(saved)
    slave.do_step(0.125, 0.125)
    after = bytes(slave._bytes)
    slave.set_real([VR["u"]], [77.0])
    slave.do_step(0.25, 0.125)
    slave._set_fmu_state(slave._fmu_state_from_bytes(saved))
    slave.do_step(0.125, 0.125)
    assert bytes(slave._bytes) == after
    other = type(slave)(instance_name="other")
    other._set_fmu_state(slave._fmu_state_from_bytes(saved))
    other.do_step(0.125, 0.125)
    assert bytes(other._bytes) == after
    with pytest.raises(ValueError, match="gain is a fixed parameter"):  # the mode was saved too
        other.set_real([VR["gain"]], [1.0])


def is_told(logged: str, message: str) -> bool:
    """Whether a message has the place and the text of an exception, and then the traceback from there on."""
    place, traced = logged.split("\n", 1)
    line = re.fullmatch(rf"Plant: sample_models\.py:(\d+): ValueError: {message}", place)
    frames = re.findall(r'File "(.+)", line (\d+)', traced)
    return line is not None and [(Path(file).name, n) for file, n in frames] == [("sample_models.py", line[1])]


@pytest.mark.parametrize(
    ("fault", "raised", "message"),
    [
        (2, RuntimeError, r'advance: the plant is "broken" by 100 % of \ faults (code 7)'),
        (3, RuntimeError, "advance returned 99; it returns 0, or a key of errors (7)"),
        (5, ValueError, "the kernel does not advance"),
    ],
)
def test_faults_of_advance_are_logged_and_raised(slave: Any, fault: int, raised: type, message: str) -> None:
    initialised(slave)
    slave.set_integer([VR["fault"]], [fault])
    with pytest.raises(raised) as caught:
        slave.do_step(0.0, 0.5)
    assert str(caught.value) == message
    (entry,) = slave.log_queue
    assert (entry.status, entry.category) == (Fmi2Status.error, "logStatusError")
    assert entry.msg.rstrip() == f"Plant: {message}" if raised is RuntimeError else is_told(entry.msg, message)


@pytest.mark.parametrize(("fault", "raised"), [(1, RuntimeError), (4, ValueError)])
def test_faults_of_start(slave: Any, fault: int, raised: type) -> None:
    slave.set_integer([VR["fault"]], [fault])
    with pytest.raises(raised):
        slave.exit_initialization_mode()
    message = slave.log_queue[0].msg
    assert raised is RuntimeError or is_told(message, "the kernel does not start")
    assert ("Traceback" in message) == (raised is ValueError)


def test_a_kernel_that_returns_nothing_is_told_so(samples: SimpleNamespace) -> None:
    slave = initialised(samples.Forgetful(instance_name="f"))
    with pytest.raises(TypeError, match="advance returned None; it returns 0, or a key of errors"):
        slave.do_step(0.0, 0.1)


def test_a_model_without_kernels(samples: SimpleNamespace) -> None:
    slave = samples.Text(instance_name="text")  # greeting, mark, u, answer, y
    slave.enter_initialization_mode()
    assert slave.get_string([0, 3]) == ["hello", "nothing yet!"]
    slave.set_string([1], ["?"])
    slave.set_real([2], [4.0])
    assert slave.get_string([3]) == ["nothing yet?"]
    assert slave.get_real([4]) == [-4.0]
    slave.exit_initialization_mode()
    assert slave.do_step(1.0, 0.5) is True
    assert slave.get_string([3]) == ["hello at 1.5?"]
    assert slave.get_real([4]) == [0.0]
    with pytest.raises(ValueError, match="answer is calculated by the FMU"):
        slave.set_string([3], ["no"])


def test_a_step_of_ones_own_that_fails_or_returns_nothing(samples: SimpleNamespace) -> None:
    slave = initialised(samples.Text(instance_name="text"))
    slave.set_string([0], ["fail"])
    with pytest.raises(RuntimeError, match="told to fail"):
        slave.do_step(0.0, 0.5)
    assert slave.log_queue[0].msg.rstrip().endswith("RuntimeError: told to fail")
    silent = type("Silent", (Model,), {"variables": (Input("u"),), "do_step": lambda self, t, h: None})
    with pytest.raises(TypeError, match="do_step returned None; it returns True, or False if it could not finish"):
        initialised(silent(instance_name="silent")).do_step(0.0, 1.0)


def test_a_model_without_kernels_or_step() -> None:
    with pytest.raises(TypeError, match="Idle has neither kernels nor a do_step of its own"):
        initialised(type("Idle", (Model,), {"variables": (Input("u"),)})(instance_name="idle")).do_step(0.0, 1.0)


def test_a_model_whose_record_is_empty(samples: SimpleNamespace) -> None:
    slave = initialised(samples.OnlyStrings(instance_name="s"))
    assert slave.do_step(0.0, 1.0) is True
    assert slave.get_string([0]) == ["42"]


def test_description_comes_with_the_build(slave: Any) -> None:
    with pytest.raises(RuntimeError, match="Plant: no model description; build the FMU with `uav-cosim build`"):
        slave.to_xml()


def test_packet_output_is_in_the_record() -> None:
    dtype, _ = record_layout((PacketOutput("tx", capacity=3),))
    assert dtype.names == ("tx_len", "tx")


def test_what_is_rare_stands_apart_from_what_every_step_touches() -> None:
    variables = (
        Parameter("rate", start=1.0),
        Parameter("seldom_read", start=2.0, rare=True),
        Memory("count"),
        Memory("seldom_kept", rare=True),
        Output("level"),
    )
    dtype, head = record_layout(variables)
    begin, end = busy_part(variables)
    assert dtype.fields is not None
    at = {name: field[1] for name, field in dtype.fields.items()}
    assert at["seldom_read"] < begin <= at["rate"] < head <= at["count"]
    assert at["level"] < end <= at["seldom_kept"]
