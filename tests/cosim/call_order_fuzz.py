"""Any FMI 2 calls in any order on a compiled Plant (sample_models.py), through ctypes, against a model in Python.

The model has the state table of FMI 2.0.5, section 4.2.4, and the record with the kernels run as plain Python. It says
of every call whether it succeeds and what it returns; one that must not succeed is fmi2Error with a logged message.
Run as a script, ``python call_order_fuzz.py LIBRARY GUID EXAMPLES``: a crash is then the end of a process.
"""

from __future__ import annotations

import base64
import ctypes
import importlib.util
import math
import sys
from ctypes import CFUNCTYPE, Structure, byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from random import Random
from typing import Any, ClassVar

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test

OK, ERROR = 0, 3
INSTANTIATED, INITIALIZATION, STEP_COMPLETE, TERMINATED, FAILED = (
    "instantiated",
    "initialization",
    "step",
    "end",
    "error",
)
EVERY = {INSTANTIATED, INITIALIZATION, STEP_COMPLETE, TERMINATED, FAILED}
READABLE = EVERY - {INSTANTIATED}
SETTABLE = {INSTANTIATED, INITIALIZATION, STEP_COMPLETE}
TYPES = {"Real": c_double, "Integer": c_int, "Boolean": c_int, "String": c_char_p}
KIND = {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer", "Boolean": "Boolean", "Packets": "String"}

LOGGER = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)


class Callbacks(Structure):
    _fields_ = [
        ("logger", LOGGER),
        ("allocate", c_void_p),
        ("free", c_void_p),
        ("finished", c_void_p),
        ("environment", c_void_p),
    ]


LOG: list[tuple[int, bytes, bytes]] = []
CALLBACKS = Callbacks(LOGGER(lambda env, name, status, category, text: LOG.append((status, category, text))))
LIBRARY = ctypes.CDLL(sys.argv[1])
GUID = sys.argv[2].encode()
LIBRARY.fmi2Instantiate.restype = c_void_p


def plant() -> Any:
    file = Path(__file__).with_name("sample_models.py")
    spec = importlib.util.spec_from_file_location("sample_models", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["sample_models"] = module
    spec.loader.exec_module(module)
    return module.Plant


PLANT = plant()
from cosim.model import flat_variables, record_layout  # noqa: E402

FLAT = flat_variables(PLANT.variables)
DTYPE, HEAD = record_layout(PLANT.variables)
START, ADVANCE = (getattr(kernel, "py_func", kernel) for kernel in PLANT.kernels)
PLAIN = sys.modules["sample_models"]
PLAIN.publish = getattr(PLAIN.publish, "py_func", PLAIN.publish)  # type: ignore[attr-defined]
DEFAULTS = PLANT.record().tobytes()


def instantiate(
    name: bytes | None = b"one", kind: int = 1, guid: bytes | None = GUID, callbacks: Any = CALLBACKS
) -> Any:
    pointer = None if callbacks is None else byref(callbacks)
    handle = LIBRARY.fmi2Instantiate(c_char_p(name), kind, c_char_p(guid), None, pointer, 0, 1)
    return None if handle is None else c_void_p(handle)


class Model:
    """What one instance should be."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.mode, self.started, self.experiment = INSTANTIATED, False, False
        self.time, self.stop = 0.0, math.inf
        self.data = bytearray(DEFAULTS)

    @property
    def m(self) -> Any:
        return np.frombuffer(self.data, np.uint8).view(DTYPE).view(np.recarray)[0]

    def snapshot(self) -> dict[str, Any]:
        return {**self.__dict__, "data": bytearray(self.data)}

    def restore(self, state: dict[str, Any]) -> None:
        self.__dict__.update({**state, "data": bytearray(state["data"])})

    def run(self, kernel: Any, *arguments: float) -> bool:
        try:
            good = kernel(self.m, *arguments) == 0
        except ValueError:
            good = False
        if not good:
            self.mode = FAILED
        return good

    def ensure_started(self) -> bool:
        if self.started:
            return True
        self.started = True
        self.data[HEAD:] = DEFAULTS[HEAD:]
        return self.run(START)

    def read(self, vr: int) -> Any:
        one = FLAT[vr]
        value = self.m[one.variable.name]
        if one.variable.kind == "Packets":
            return base64.b64encode(value[: self.m[f"{one.variable.name}_len"]].tobytes())
        return (value if one.index is None else value[one.index]).item()

    def may_set(self, vr: int, value: Any) -> bool:
        variable = FLAT[vr].variable
        if variable.role == "parameter" and not variable.tunable and self.mode == STEP_COMPLETE:
            return False
        if variable.role not in ("parameter", "input", "packet input"):
            return False
        if variable.kind == "Packets":
            if value is None:
                return False
            try:
                return len(base64.b64decode(value, validate=True)) <= variable.capacity
            except ValueError:
                return False
        low, high = variable.limits()
        return bool(variable.kind == "Boolean" or low <= value <= high)

    def write(self, vr: int, value: Any) -> None:
        one = FLAT[vr]
        name, m = one.variable.name, self.m
        if one.variable.kind == "Packets":
            decoded = base64.b64decode(value)
            m[name][: len(decoded)] = np.frombuffer(decoded, np.uint8)
            m[f"{name}_len"] = len(decoded)
        elif one.index is None:
            m[name] = bool(value) if one.variable.kind == "Boolean" else value
        else:
            m[name][one.index] = bool(value) if one.variable.kind == "Boolean" else value


OWN = {kind: [i for i, one in enumerate(FLAT) if KIND[one.variable.kind] == kind] for kind in TYPES}
SETTABLE_ROLES = ("parameter", "input", "packet input")
OWN_SETTABLE = {kind: [i for i in own if FLAT[i].variable.role in SETTABLE_ROLES] for kind, own in OWN.items()}
KINDS = sorted(TYPES)
WRONG_REFERENCES = [*range(len(FLAT)), len(FLAT), 2**31, 2**32 - 1]
ODD_REALS = [0.0, 1.0, 2.5, 10.0, 10.5, -1.0, math.nan, math.inf, -math.inf, 1e308, 5e-324]
ODD_TEXTS = [None, b"", b"=", b"A", b"AA", b"AAA", b"A===", b"AA=A", b"AA==AAAA", b"AA AA", b"\xff\xfe\xfd\xfc"]
LONG_TEXTS = [b"A" * 2**20, b"%n%s%x" * 1000, b"=" * 4096]
LONG_NAMES = [b"%s%n" * 99, b"x" * 2**20]


def a_reference(r: Random, own: list[int]) -> int:
    """Mostly one of `own`; sometimes any, or none that there is."""
    return r.choice(own if r.random() < 0.93 else WRONG_REFERENCES)


def a_time(r: Random) -> float:
    return r.choice([0.0, 0.125, 0.5, -1.0, math.nan, math.inf, 1e300, r.uniform(-2.0, 2.0)])


def a_value(r: Random, kind: str) -> Any:
    if kind == "Real":
        return r.uniform(0.0, 9.0) if r.random() < 0.7 else r.choice(ODD_REALS)
    if kind == "Integer":
        return r.choice([1, 2, 3]) if r.random() < 0.7 else r.choice([0, 4, 5, 7, -1, 1000, 1001, 2**31 - 1, -(2**31)])
    if kind == "Boolean":
        return r.choice([0, 1, -1, 7])
    if r.random() < 0.6:
        return base64.b64encode(r.randbytes(r.randrange(13)))
    return r.choice(ODD_TEXTS) if r.random() < 0.97 else r.choice(LONG_TEXTS)


class Calls(RuleBasedStateMachine):
    """Two instances and the states saved from them."""

    def __init__(self) -> None:
        super().__init__()
        self.handles = [instantiate() for _ in range(2)]
        self.models = [Model() for _ in range(2)]
        self.done = 0
        self.states: list[tuple[c_void_p, dict[str, Any]]] = []
        self.stored: list[tuple[bytes, dict[str, Any]]] = []
        assert all(self.handles)
        LOG.clear()

    def call(self, name: str, slot: int, *arguments: Any, good: bool) -> int:
        LOG.clear()
        status = int(getattr(LIBRARY, f"fmi2{name}")(self.handles[slot], *arguments))
        assert status == (OK if good else ERROR), (name, status, self.models[slot].mode, LOG)
        if good:
            assert LOG == [], (name, LOG)
        else:
            assert len(LOG) == 1, (name, LOG)
            assert LOG[0][0] == ERROR
            assert LOG[0][1] == b"logStatusError"
            assert len(LOG[0][2]) > 10
            self.models[slot].mode = FAILED
        return status

    # ---- life cycle ----

    def setup_experiment(self, slot: int, r: Random) -> None:
        self.set_up(slot, a_time(r), r.random() < 0.5, a_time(r))

    def set_up(self, slot: int, start: float, has_stop: bool, stop: float) -> None:
        model = self.models[slot]
        good = model.mode == INSTANTIATED and math.isfinite(start) and (not has_stop or stop >= start)
        arguments = (0, c_double(0.0), c_double(start), int(has_stop), c_double(stop))
        self.call("SetupExperiment", slot, *arguments, good=good)
        if good:
            model.experiment, model.time, model.stop = True, start, stop if has_stop else math.inf

    def enter_initialization_mode(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        good = model.mode == INSTANTIATED and model.experiment
        self.call("EnterInitializationMode", slot, good=good)
        if good:
            model.mode = INITIALIZATION

    def exit_initialization_mode(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        good = model.mode == INITIALIZATION and model.ensure_started()
        self.call("ExitInitializationMode", slot, good=good)
        if good:
            model.mode = STEP_COMPLETE

    def bring(self, slot: int, r: Random) -> None:
        """The short way into a state; many random calls lead into the error state, where little is possible."""
        to = r.choice([INSTANTIATED, INITIALIZATION, INITIALIZATION, STEP_COMPLETE, STEP_COMPLETE, TERMINATED])
        self.reset(slot, r)
        if to != INSTANTIATED:
            self.set_up(slot, 0.0, False, 0.0)
            self.enter_initialization_mode(slot, r)
        if to in (STEP_COMPLETE, TERMINATED):
            self.exit_initialization_mode(slot, r)
        if to == TERMINATED:
            self.terminate(slot, r)

    def terminate(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        good = model.mode == STEP_COMPLETE
        self.call("Terminate", slot, good=good)
        if good:
            model.mode = TERMINATED

    def reset(self, slot: int, r: Random) -> None:
        self.call("Reset", slot, good=True)
        self.models[slot].reset()

    def free_and_instantiate(self, slot: int, r: Random) -> None:
        LIBRARY.fmi2FreeInstance(self.handles[slot])
        self.handles[slot] = instantiate()
        assert self.handles[slot]
        self.models[slot].reset()

    def instantiate_anything(self, slot: int, r: Random) -> None:
        name = r.choice([None, b"", b"one", *LONG_NAMES])
        kind = r.choice([0, 1, 1, 1, 2, -1])
        guid = r.choice([None, b"", GUID, GUID, b"%n" * 600, b"g" * 2**20])
        callbacks = r.choice([None, Callbacks(), CALLBACKS])
        LOG.clear()
        handle = instantiate(name, kind, guid, callbacks)
        good = bool(name) and kind == 1 and guid == GUID and callbacks is not None
        assert (handle is not None) == good
        if callbacks is CALLBACKS:
            assert len(LOG) == (not good)
        if handle is not None:
            assert LIBRARY.fmi2Terminate(handle) == ERROR  # without a logger, perhaps
            LIBRARY.fmi2FreeInstance(handle)

    def no_instance(self, slot: int, r: Random) -> None:
        name = r.choice(["Terminate", "Reset", "EnterInitializationMode", "ExitInitializationMode", "CancelStep"])
        LIBRARY.fmi2FreeInstance(None)
        assert getattr(LIBRARY, f"fmi2{name}")(None) == ERROR

    # ---- stepping ----

    def step_on(self, slot: int, r: Random) -> None:
        self.step(slot, self.models[slot].time, r.choice([0.125, 0.25, 0.1]))

    def do_step(self, slot: int, r: Random) -> None:
        self.step(slot, a_time(r), a_time(r))

    def step(self, slot: int, t: float, h: float) -> None:
        model = self.models[slot]
        good = model.mode == STEP_COMPLETE and 0.0 < h < math.inf
        slack = 1e-6 * h + 1e-12 * abs(t)
        good = good and abs(t - model.time) <= slack and t + h <= model.stop + slack
        if good:
            good = model.run(ADVANCE, t, h)
        self.call("DoStep", slot, c_double(t), c_double(h), 1, good=good)
        if good:
            model.time = t + h

    def get_status(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        name, null = r.choice(["", "Real", "Integer", "Boolean", "String"]), r.random() < 0.1
        right = {"": 0, "String": 1, "Real": 2, "Boolean": 3}.get(name)
        kind = right if right is not None and r.random() < 0.7 else r.randrange(-1, 5)
        value: Any = {"Real": c_double(7.0), "String": c_char_p(b"?")}.get(name, c_int(7))
        good = model.mode in (STEP_COMPLETE, TERMINATED, FAILED) and kind == right and not null
        expected = {"": ERROR if model.mode == FAILED else OK, "Real": model.time, "Boolean": 0, "String": b""}.get(
            name
        )
        self.call(f"Get{name}Status", slot, kind, None if null else byref(value), good=good)
        if good:
            assert value.value == expected

    # ---- values ----

    def get(self, slot: int, r: Random) -> None:
        model, kind = self.models[slot], r.choice(KINDS)
        vrs = [a_reference(r, OWN[kind]) for _ in range(r.randrange(5))]
        null = r.randrange(40)
        good = model.mode in READABLE and not (vrs and null in (0, 1))
        if good and model.mode == INITIALIZATION:
            good = model.ensure_started()
        good = good and all(vr < len(FLAT) and KIND[FLAT[vr].variable.kind] == kind for vr in vrs)
        values = (TYPES[kind] * max(1, len(vrs)))()
        pointers: list[Any] = [(c_uint * max(1, len(vrs)))(*vrs), values]
        if null in (0, 1):
            pointers[null] = None
        self.call(f"Get{kind}", slot, pointers[0], c_size_t(len(vrs)), pointers[1], good=good)
        if good:
            got = [bool(v) if kind == "Boolean" else v for v in values[: len(vrs)]]
            expected = [bool(v) if kind == "Boolean" else v for v in map(model.read, vrs)]
            assert [repr(v) for v in got] == [repr(v) for v in expected], (vrs, got, expected)

    def set(self, slot: int, r: Random) -> None:
        model, kind = self.models[slot], r.choice(KINDS)
        pairs = [(a_reference(r, OWN_SETTABLE[kind]), a_value(r, kind)) for _ in range(r.randrange(4))]
        null = r.randrange(40)
        good = model.mode in SETTABLE and not (pairs and null in (0, 1))
        for vr, value in pairs:
            good = good and vr < len(FLAT) and KIND[FLAT[vr].variable.kind] == kind and model.may_set(vr, value)
        pointers: list[Any] = [
            (c_uint * max(1, len(pairs)))(*(vr for vr, _ in pairs)),
            (TYPES[kind] * max(1, len(pairs)))(*(value for _, value in pairs)),
        ]
        if null in (0, 1):
            pointers[null] = None
        self.call(f"Set{kind}", slot, pointers[0], c_size_t(len(pairs)), pointers[1], good=good)
        if good:
            for vr, value in pairs:
                model.write(vr, value)
            model.started = model.started and model.mode == STEP_COMPLETE

    # ---- saved states ----

    def get_state(self, slot: int, r: Random) -> None:
        """Into a new state, or into one that there is."""
        if len(self.states) < 4:
            state = c_void_p()
            self.states.append((state, {}))
            which = len(self.states) - 1
        else:
            which = r.randrange(4)
        self.call("GetFMUstate", slot, byref(self.states[which][0]), good=True)
        self.states[which] = (self.states[which][0], self.models[slot].snapshot())

    def set_state(self, slot: int, r: Random) -> None:
        if self.states:
            state, snapshot = r.choice(self.states)
            self.call("SetFMUstate", slot, state, good=True)
            self.models[slot].restore(snapshot)

    def free_state(self, slot: int, r: Random) -> None:
        if self.states:
            state, _ = self.states.pop(r.randrange(len(self.states)))
            self.call("FreeFMUstate", slot, byref(state), good=True)
            assert state.value is None
            self.call("FreeFMUstate", slot, byref(state), good=True)

    def serialize(self, slot: int, r: Random) -> None:
        if self.states:
            (state, snapshot), short = r.choice(self.states), r.random() < 0.1
            size = c_size_t()
            self.call("SerializedFMUstateSize", slot, state, byref(size), good=True)
            given = size.value - short
            buffer = ctypes.create_string_buffer(given)
            self.call("SerializeFMUstate", slot, state, buffer, c_size_t(given), good=not short)
            if not short:
                self.stored = [*self.stored[-3:], (buffer.raw, snapshot)]

    def deserialize(self, slot: int, r: Random) -> None:
        if not self.stored:
            return
        data, snapshot = r.choice(self.stored)
        damage, at = r.randrange(12), r.randrange(len(data))
        if damage == 0:
            data = data[:at]
        elif damage == 1:
            data = data + b"\0"
        elif damage == 2:
            data = data[:at] + bytes([data[at] ^ r.randrange(1, 256)]) + data[at + 1 :]
        state = c_void_p()
        self.call("DeSerializeFMUstate", slot, data, c_size_t(len(data)), byref(state), good=damage > 2)
        if damage > 2:
            self.call("SetFMUstate", slot, state, good=True)
            self.models[slot].restore(snapshot)
            self.call("FreeFMUstate", slot, byref(state), good=True)

    def no_state(self, slot: int, r: Random) -> None:
        match r.randrange(7):
            case 0:
                self.call("FreeFMUstate", slot, None, good=True)
            case 1:
                self.call("GetFMUstate", slot, None, good=False)
            case 2:
                self.call("SetFMUstate", slot, None, good=False)
            case 3:
                self.call("SerializedFMUstateSize", slot, None, byref(c_size_t()), good=False)
            case 4:
                self.call("SetFMUstate", slot, ctypes.create_string_buffer(b"{another}", 64), good=False)
            case 5:
                self.call("SerializeFMUstate", slot, None, None, c_size_t(9), good=False)
            case _:
                self.call("DeSerializeFMUstate", slot, None, c_size_t(9), byref(c_void_p()), good=False)

    # ---- what is not provided, and the rest ----

    def not_provided(self, slot: int, r: Random) -> None:
        nothing = (None, c_size_t(0))
        name, *arguments = r.choice(
            [
                ("CancelStep",),
                ("SetRealInputDerivatives", None, c_size_t(1), None, None),
                ("GetRealOutputDerivatives", None, c_size_t(1), None, None),
                ("GetDirectionalDerivative", *nothing, *nothing, None, None),
            ]
        )
        self.call(name, slot, *arguments, good=False)

    def set_debug_logging(self, slot: int, r: Random) -> None:
        names = [r.choice([b"logStatusError"] * 5 + [b"logAll", None, b"%n"]) for _ in range(r.randrange(3))]
        null = r.random() < 0.1
        array = (c_char_p * max(1, len(names)))(*names)
        good = all(name == b"logStatusError" for name in names) and not (names and null)
        arguments = (r.randrange(2), c_size_t(len(names)), None if null else array)
        self.call("SetDebugLogging", slot, *arguments, good=good)

    # ---- which of them ----

    WEIGHTS: ClassVar[dict[str, int]] = {
        "setup_experiment": 2,
        "enter_initialization_mode": 3,
        "exit_initialization_mode": 3,
        "bring": 3,
        "terminate": 1,
        "reset": 1,
        "free_and_instantiate": 1,
        "instantiate_anything": 1,
        "no_instance": 1,
        "step_on": 8,
        "do_step": 2,
        "get_status": 3,
        "get": 20,
        "set": 20,
        "get_state": 3,
        "set_state": 3,
        "free_state": 1,
        "serialize": 2,
        "deserialize": 2,
        "no_state": 1,
        "not_provided": 1,
        "set_debug_logging": 1,
    }

    @rule(seed=st.integers(0, 2**32 - 1), calls=st.integers(1, 20))
    def any_calls(self, seed: int, calls: int) -> None:
        """Python's own generator chooses, which is hundreds of times faster; hypothesis shortens what fails."""
        r = Random(f"{seed} {self.done}")
        for name in r.choices(list(self.WEIGHTS), list(self.WEIGHTS.values()), k=calls):
            self.done += 1
            slot = r.randrange(2)
            if self.models[slot].mode == FAILED and r.random() < 0.5:
                self.bring(slot, r)
            getattr(self, name)(slot, r)
            self.both_are_as_they_should_be()

    def both_are_as_they_should_be(self) -> None:
        """A call changes no instance but the one that it is for."""
        for handle, model in zip(self.handles, self.models, strict=True):
            if model.mode == STEP_COMPLETE:
                vr, value = (c_uint * 2)(9, 0), (c_double * 2)()
                assert LIBRARY.fmi2GetReal(handle, vr, c_size_t(2), value) == OK
                assert [repr(v) for v in value] == [repr(float(v)) for v in (model.m.x, model.m.y)]

    def teardown(self) -> None:
        for state, _ in self.states:
            assert LIBRARY.fmi2FreeFMUstate(self.handles[0], byref(state)) == OK
        for handle in self.handles:
            LIBRARY.fmi2FreeInstance(handle)


def main() -> None:
    LIBRARY.fmi2GetVersion.restype = LIBRARY.fmi2GetTypesPlatform.restype = c_char_p
    assert (LIBRARY.fmi2GetVersion(), LIBRARY.fmi2GetTypesPlatform()) == (b"2.0", b"default")
    run = settings(
        max_examples=int(sys.argv[3]),
        stateful_step_count=10,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    np.seterr(all="ignore")
    run_state_machine_as_test(Calls, settings=run)
    print("sequences:", sys.argv[3])


if __name__ == "__main__":
    main()
