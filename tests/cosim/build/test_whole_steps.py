"""A step in one call (`uav_cosim_note_step`, `uav_cosim_make_step`) beside the calls of FMI that it stands for."""

from __future__ import annotations

import base64
import ctypes
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from cosim import Model
from cosim.build import build
from cosim.model import flat_variables
from tests.cosim import driving
from tests.cosim.build.test_compiled_fmu import MODELS, Factory, every_model, serialized

KINDS = ("Real", "Integer", "Boolean")
NOT_BEGUN, NOT_READ = -1, -2
Reals, Integers = ctypes.c_double, ctypes.c_int32


class Whole(ctypes.Structure):
    """The arguments of a step, as fmi2.c declares them."""

    _fields_ = [("instance", ctypes.c_void_p), ("moves", ctypes.c_void_p), ("values", ctypes.c_void_p * 8)]


class Packets(ctypes.Structure):
    """Packets as bytes."""

    _fields_ = [("bytes", ctypes.c_void_p), ("size", ctypes.c_uint64)]


class Stepped:
    """An instance that makes steps in one call; `set` and `get`: value references by kind, packets last."""

    def __init__(self, fmu: FMU2Slave, set: Sequence[Sequence[int]], get: Sequence[Sequence[int]]) -> None:
        groups = [*set, *[[]] * (4 - len(set)), *get]
        every = [reference for group in groups for reference in group]
        self._moves = (ctypes.c_uint64 * (4 + 3 * len(every)))()
        note = fmu.dll.uav_cosim_note_step
        counts = (ctypes.c_uint32 * 8)(*map(len, groups))
        self.refused = note(counts, (ctypes.c_uint32 * len(every))(*every), self._moves)
        kinds = (Reals, Integers, Integers, Packets) * 2
        self.values: list[Any] = [(kind * len(group))() for kind, group in zip(kinds, groups, strict=True)]
        places = (ctypes.addressof(own) for own in self.values)
        self._whole = Whole(fmu.component, ctypes.addressof(self._moves), (ctypes.c_void_p * 8)(*places))
        self._step = fmu.dll.uav_cosim_make_step
        self._step.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int]

    def step(self, values: Sequence[Sequence[Any]], t: float, h: float, packets: bytes | None = None) -> int:
        for own, new in zip(self.values, values, strict=False):
            own[:] = list(new)
        if packets is not None:
            given = ctypes.create_string_buffer(packets, max(1, len(packets)))
            self.values[3][0] = Packets(ctypes.addressof(given), len(packets))
        return int(self._step(ctypes.addressof(self._whole), t, h, packets is not None))

    @property
    def sent(self) -> bytes:
        """The packets that were got."""
        return ctypes.string_at(self.values[7][0].bytes, self.values[7][0].size)


def references(model: type[Model], *roles: str) -> list[list[int]]:
    """Value references of variables with these roles: reals, integers, booleans, packets."""
    every = [(i, one.variable) for i, one in enumerate(flat_variables(model.variables))]
    every = [(i, one) for i, one in every if one.role in roles]
    kinds = {"Real": 0, "Integer": 1, "Enumeration": 1, "Boolean": 2, "Packets": 3}
    return [[i for i, one in every if kinds.get(one.kind) == kind] for kind in range(4)]


@every_model
def test_steps_in_one_call_are_those_of_fmi(name: str, fmus: Path, tmp_path: Path) -> None:
    model, make = MODELS[name], Factory(fmus / f"{name}.fmu", tmp_path)
    fmu, other = make(), make("other")
    inputs = dict(driving.inputs(model))
    own = [*references(model, "input")[:3], references(model, "packet input")[3][:1]]
    others = references(model, "packet input")[3][1:]
    read = references(model, "output", "packet output")
    unread = read[3][1:]
    read[3] = read[3][:1]
    whole = Stepped(fmu, own, read)
    assert whole.refused == 0
    for step in range(60):
        t = step * model.step_size
        driving.set_inputs(model, other, step)
        other.doStep(t, model.step_size)
        for reference in others:
            text = base64.b64encode(driving.value(inputs[reference], reference, step)).decode()
            fmu.setString([reference], [text])
        values = [[driving.value(inputs[i], i, step) for i in group] for group in own[:3]]
        packets = driving.value(inputs[own[3][0]], own[3][0], step) if own[3] else None
        assert whole.step(values, t, model.step_size, packets) == 0
        assert serialized(fmu) == serialized(other)
        for kind, group, found in zip(KINDS, read, whole.values[4:], strict=False):
            assert list(found) == list(getattr(other, f"get{kind}")(group))
        if read[3]:
            assert [base64.b64encode(whole.sent)] == other.getString(read[3])
        assert fmu.getString(unread) == other.getString(unread)


@pytest.fixture(scope="module")
def plant(compiled_plant: Path, tmp_path_factory: pytest.TempPathFactory) -> Factory:
    return Factory(compiled_plant, tmp_path_factory.mktemp("plant"))


U, W, COUNT, ENABLE, GEAR = [1], [2, 3, 4], [5], [6], [7]


def test_a_step_by_hand(plant: Factory, samples: SimpleNamespace) -> None:
    """x' = 2 u, y = x + 2 u, z = (w0 + w1, w2), total = count * 100, tx = the number of steps; h = 1/8 s."""
    names = [one.name for one in flat_variables(samples.Plant.variables)]
    places = [names.index(one) for one in ("y", "z[1]", "z[2]", "total", "engaged", "ready", "tx")]
    get = [places[:3], places[3:5], places[5:6], places[6:]]
    assert [names[i] for i in (*U, *W, *COUNT, *ENABLE, *GEAR)][::3] == ["u", "w[3]", "gear"]
    stepped = Stepped(plant(), [[*U, *W], [*COUNT, *GEAR], ENABLE], get)
    assert stepped.step([[4.0, 0.5, 0.25, 7.0], [3, 3], [0]], 0.0, 0.125) == 0
    assert [list(own) for own in stepped.values[4:7]] == [[19.0, 0.75, 7.0], [300, 3], [0]]
    assert stepped.sent == b"\x02"
    assert stepped.step([[0.0, 0.5, 0.25, 8.0], [1, 1], [1]], 0.125, 0.125) == 0
    assert [list(own) for own in stepped.values[4:7]] == [[11.0, 0.75, 8.0], [100, 1], [1]]
    assert stepped.sent == b"\x03"


def test_packets_are_set_if_there_are_some(plant: Factory, samples: SimpleNamespace) -> None:
    """Without, they stay as they are; none is a number of bytes, too. More than fit are left to the calls of FMI."""
    rx = [i for i, one in enumerate(flat_variables(samples.Plant.variables)) if one.variable.role == "packet input"]
    fmu = plant()
    stepped = Stepped(fmu, [U, [], [], rx], [[]] * 4)
    given = ((b"\xfe\x00z", "/gB6"), (None, "/gB6"), (b"", ""), (b"ab", "YWI="))
    for step, (packets, expected) in enumerate(given):
        assert stepped.step([[0.5]], 0.125 * step, 0.125, packets) == 0
        assert [text.decode() for text in fmu.getString(rx)] == [expected]
    capacity = flat_variables(samples.Plant.variables)[rx[0]].variable.capacity
    assert stepped.step([[0.5]], 0.5, 0.125, b"x" * (capacity + 1)) == NOT_BEGUN
    assert stepped.step([[0.5]], 0.5, 0.125, b"x" * capacity) == 0


@pytest.mark.parametrize(
    ("set", "get"),
    [
        ([[0], [], []], [[], [], [], []]),  # y is an output
        ([[1000], [], []], [[], [], [], []]),
        ([[5], [], []], [[], [], [], []]),  # count is an integer
        ([[], [], []], [[5], [], [], []]),
        ([[], [], []], [[], [], [], [1]]),  # u are no packets
    ],
)
def test_variables_that_no_step_can_set_or_get_are_refused(plant: Factory, set: Any, get: Any) -> None:
    assert Stepped(plant(), set, get).refused == 1


def test_a_fixed_parameter_is_refused_and_a_tunable_one_is_set(plant: Factory, samples: SimpleNamespace) -> None:
    names = [one.name for one in flat_variables(samples.Plant.variables)]
    assert Stepped(plant(), [[names.index("gain")], [], []], [[]] * 4).refused == 1
    stepped = Stepped(plant(), [[names.index("trim")], [], []], [[0], [], [], []])
    assert stepped.step([[0.25]], 0.0, 0.125) == 0
    assert list(stepped.values[4]) == [10.0 + 0.125 * 2.0 * 0.5 + 0.25 + 2.0 * 0.5]


@pytest.mark.parametrize(
    ("u", "gear", "expected"),
    [(math.nan, 2, NOT_BEGUN), (0.5, 4, NOT_BEGUN), (0.5, 0, NOT_BEGUN), (math.inf, 3, 0), (-1e300, 1, 0)],
)
def test_values_outside_their_limits_are_left_to_the_calls_of_fmi(
    plant: Factory, u: float, gear: int, expected: int
) -> None:
    """Gears are 1 to 3, u has no limits, and NaN is outside any."""
    fmu = plant()
    stepped = Stepped(fmu, [U, GEAR, []], [[0], [], [], []])
    assert stepped.step([[u], [gear]], 0.0, 0.125) == expected
    fmu.doStep(0.125 if expected == 0 else 0.0, 0.125)  # the time at which it is


def test_no_step_is_made_in_another_state(plant: Factory) -> None:
    fmu = plant(initialise=False)
    stepped = Stepped(fmu, [U, [], []], [[0], [], [], []])
    assert stepped.step([[0.5]], 0.0, 0.125) == NOT_BEGUN
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    assert stepped.step([[0.5]], 0.0, 0.125) == NOT_BEGUN
    fmu.exitInitializationMode()
    assert stepped.step([[0.5]], 0.0, 0.125) == 0


def test_a_step_that_fails_says_what_a_step_of_fmi_says(plant: Factory, samples: SimpleNamespace) -> None:
    names = [one.name for one in flat_variables(samples.Plant.variables)]
    told = []
    for whole in (False, True):
        fmu = plant()
        plant.log.clear()
        fault = [names.index("fault")]
        if whole:
            assert Stepped(fmu, [[], fault, []], [[]] * 4).step([[], [2]], 0.0, 0.125) == 3
        else:
            fmu.setInteger(fault, [2])
            with pytest.raises(FMICallException):
                fmu.doStep(0.0, 0.125)
        told.append([*plant.log])
    assert told[0] == told[1]
    assert 'the plant is "broken"' in told[0][0]


def test_packets_of_an_impossible_length_are_left_to_the_calls_of_fmi(samples: SimpleNamespace, tmp_path: Path) -> None:
    make = Factory(build(samples.Boastful, tmp_path).file, tmp_path / "unpacked")
    fmu = make()
    stepped = Stepped(fmu, [[0], [], []], [[], [], [], [1]])
    assert stepped.step([[4.0]], 0.0, 0.5) == 0
    assert stepped.sent == bytes(4)
    assert stepped.step([[5.0]], 0.5, 0.5) == NOT_READ
    with pytest.raises(FMICallException):
        fmu.getString([1])
    assert make.log == ["tx: the kernel reports 5 bytes, its capacity is 4"]
    fmu = make()
    assert Stepped(fmu, [[0], [], []], [[], [], [], [1]]).step([[-1.0]], 0.0, 0.5) == NOT_READ
    with pytest.raises(FMICallException):
        fmu.getString([1])
    assert make.log[1:] == [
        "tx: a packet does not fit into its 4 bytes, or its message is not in the dialect; send less in a step, or "
        "give it a larger capacity"
    ]
