"""Any FMI 3 calls in any order on a compiled Plant (sample_models.py), through ctypes, against a model in Python.

The model has the state table of FMI 3.0.2, sections 2.3 and 4.2, and the record with the kernels run as plain Python;
see call_order_fuzz.py, which does the same for FMI 2. Run as a script, ``python call_order_fuzz3.py LIBRARY TOKEN
EXAMPLES``: a crash is then the end of a process.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import sys
from ctypes import (
    CFUNCTYPE,
    byref,
    c_bool,
    c_char_p,
    c_double,
    c_float,
    c_int,
    c_int64,
    c_size_t,
    c_uint,
    c_uint8,
    c_void_p,
)
from pathlib import Path
from random import Random
from typing import Any, ClassVar

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test

OK, ERROR = 0, 3
INSTANTIATED, INITIALIZATION, STEP, TERMINATED, FAILED = "instantiated", "initialization", "step", "end", "error"
TYPES = {"Float64": c_double, "Int32": c_int, "Int64": c_int64, "Boolean": c_bool, "Float32": c_float, "UInt8": c_uint8}
TYPE = {"Real": "Float64", "Integer": "Int32", "Enumeration": "Int64", "Boolean": "Boolean", "Packets": "Binary"}
SET_BY_ENVIRONMENT = ("parameter", "input", "packet input")

LOGGER = CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
LOG: list[tuple[int, bytes, bytes]] = []
LOGGING = LOGGER(lambda environment, status, category, text: LOG.append((status, category, text)))
LIBRARY = ctypes.CDLL(sys.argv[1])
TOKEN = sys.argv[2].encode()
LIBRARY.fmi3InstantiateCoSimulation.restype = c_void_p


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
from cosim.build.description3 import exported  # noqa: E402
from cosim.model import record_layout  # noqa: E402

VARIABLES = exported(PLANT)
DTYPE, HEAD = record_layout(PLANT.variables)
START, ADVANCE = (getattr(kernel, "py_func", kernel) for kernel in PLANT.kernels)
PLAIN = sys.modules["sample_models"]
PLAIN.publish = getattr(PLAIN.publish, "py_func", PLAIN.publish)  # type: ignore[attr-defined]
DEFAULTS = PLANT.record().tobytes()
TIME = len(VARIABLES)
Y, X = (next(i for i, v in enumerate(VARIABLES) if v.name == name) for name in "yx")


def count(vr: int) -> int:
    return VARIABLES[vr].shape[0] if vr < TIME and VARIABLES[vr].shape else 1


def instantiate(
    name: bytes | None = b"one",
    token: bytes | None = TOKEN,
    events: bool = False,
    needed: int = 0,
    logger: Any = LOGGING,
) -> Any:
    flags = (c_bool(False), c_bool(True), c_bool(events), c_bool(False))
    required = (c_uint * 1)(0)
    handle = LIBRARY.fmi3InstantiateCoSimulation(
        c_char_p(name), c_char_p(token), None, *flags, required, c_size_t(needed), None, logger, None
    )
    return None if handle is None else c_void_p(handle)


class Model:
    """What one instance should be."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.mode, self.started = INSTANTIATED, False
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

    def may_read(self, vr: int, kind: str) -> bool:
        if vr == TIME:
            return kind == "Float64"
        if vr > TIME or TYPE[VARIABLES[vr].kind] != kind:
            return False
        return self.mode != INSTANTIATED or VARIABLES[vr].role in SET_BY_ENVIRONMENT

    def read(self, vr: int) -> list[Any]:
        if vr == TIME:
            return [self.time]
        v = VARIABLES[vr]
        value = self.m[v.name]
        if v.kind == "Packets":
            return [value[: self.m[f"{v.name}_len"]].tobytes()]
        return [x.item() for x in np.atleast_1d(value)]

    def may_set(self, vr: int, kind: str, values: list[Any]) -> bool:
        if vr >= TIME or TYPE[VARIABLES[vr].kind] != kind or VARIABLES[vr].role not in SET_BY_ENVIRONMENT:
            return False
        v = VARIABLES[vr]
        if v.role == "parameter" and not v.tunable and self.mode == STEP:
            return False
        if kind == "Binary":
            return all(len(x) <= v.capacity for x in values)
        low, high = v.limits()
        return kind == "Boolean" or all(low <= x <= high for x in values)

    def write(self, vr: int, values: list[Any]) -> None:
        v, m = VARIABLES[vr], self.m
        if v.kind == "Packets":
            m[v.name][: len(values[0])] = np.frombuffer(values[0], np.uint8)
            m[f"{v.name}_len"] = len(values[0])
        else:
            m[v.name] = values if v.shape else values[0]


KINDS = ["Float64", "Int32", "Int64", "Boolean", "Binary"]
OWN = {kind: [i for i, v in enumerate(VARIABLES) if TYPE[v.kind] == kind] for kind in KINDS}
OWN_SETTABLE = {kind: [i for i in own if VARIABLES[i].role in SET_BY_ENVIRONMENT] for kind, own in OWN.items()}
WRONG = [*range(TIME + 2), 2**31, 2**32 - 1]
ODD_FLOATS = [0.0, 1.0, 10.0, 10.5, -1.0, math.nan, math.inf, -math.inf, 1e308, 5e-324]
ODD_INTEGERS = [0, 4, 5, 7, -1, 1000, 1001, 2**31 - 1, -(2**31)]


def a_reference(r: Random, own: list[int]) -> int:
    return r.choice(own if r.random() < 0.94 else WRONG)


def a_time(r: Random) -> float:
    return r.choice([0.0, 0.125, 0.5, -1.0, math.nan, math.inf, 1e300, r.uniform(-2.0, 2.0)])


def a_value(r: Random, kind: str) -> Any:
    if kind == "Float64":
        return r.uniform(0.0, 9.0) if r.random() < 0.8 else r.choice(ODD_FLOATS)
    if kind == "Boolean":
        return r.random() < 0.5
    if kind == "Binary":
        return r.randbytes(r.randrange(13)) if r.random() < 0.95 else bytes(2**16)
    wide = [2**40, -(2**40), 2**32 + 2] if kind == "Int64" else []
    return r.choice([1, 2, 3]) if r.random() < 0.7 else r.choice(ODD_INTEGERS + wide)


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

    def call(self, name: str, slot: int, *arguments: Any, good: bool) -> None:
        LOG.clear()
        status = int(getattr(LIBRARY, f"fmi3{name}")(self.handles[slot], *arguments))
        assert status == (OK if good else ERROR), (name, status, self.models[slot].mode, LOG)
        if good:
            assert LOG == [], (name, LOG)
        else:
            assert len(LOG) == 1, (name, LOG)
            assert LOG[0][:2] == (ERROR, b"logStatusError")
            assert len(LOG[0][2]) > 10
            self.models[slot].mode = FAILED

    # ---- life cycle ----

    def enter_initialization_mode(self, slot: int, r: Random) -> None:
        self.enter(slot, a_time(r), r.random() < 0.5, a_time(r))

    def enter(self, slot: int, start: float, has_stop: bool, stop: float) -> None:
        model = self.models[slot]
        good = model.mode == INSTANTIATED and math.isfinite(start) and (not has_stop or stop >= start)
        arguments = (c_bool(False), c_double(0.0), c_double(start), c_bool(has_stop), c_double(stop))
        self.call("EnterInitializationMode", slot, *arguments, good=good)
        if good:
            model.mode, model.time, model.stop = INITIALIZATION, start, stop if has_stop else math.inf

    def exit_initialization_mode(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        good = model.mode == INITIALIZATION and model.ensure_started()
        self.call("ExitInitializationMode", slot, good=good)
        if good:
            model.mode = STEP

    def bring(self, slot: int, r: Random) -> None:
        """The short way into a state; many random calls lead into the error state, where little is possible."""
        to = r.choice([INSTANTIATED, INITIALIZATION, INITIALIZATION, STEP, STEP, TERMINATED])
        self.reset(slot, r)
        if to != INSTANTIATED:
            self.enter(slot, 0.0, False, 0.0)
        if to in (STEP, TERMINATED):
            self.exit_initialization_mode(slot, r)
        if to == TERMINATED:
            self.terminate(slot, r)

    def terminate(self, slot: int, r: Random) -> None:
        good = self.models[slot].mode == STEP
        self.call("Terminate", slot, good=good)
        if good:
            self.models[slot].mode = TERMINATED

    def reset(self, slot: int, r: Random) -> None:
        self.call("Reset", slot, good=True)
        self.models[slot].reset()

    def instantiate_anything(self, slot: int, r: Random) -> None:
        name, token = r.choice([None, b"", b"one", b"x" * 2**16]), r.choice([None, b"", TOKEN, TOKEN, b"%n" * 600])
        events, needed = r.random() < 0.2, r.choice([0, 0, 0, 1])
        LOG.clear()
        handle = instantiate(name, token, events, needed)
        good = bool(name) and token == TOKEN and not events and not needed
        assert (handle is not None) == good
        assert len(LOG) == (not good)
        if handle is not None:
            LIBRARY.fmi3FreeInstance(handle)

    def no_instance(self, slot: int, r: Random) -> None:
        LIBRARY.fmi3FreeInstance(None)
        name = r.choice(["Terminate", "Reset", "ExitInitializationMode", "EnterEventMode", "EnterStepMode"])
        assert getattr(LIBRARY, f"fmi3{name}")(None) == ERROR

    # ---- stepping ----

    def step_on(self, slot: int, r: Random) -> None:
        self.step(slot, self.models[slot].time, r.choice([0.125, 0.25, 0.1]), -1)

    def do_step(self, slot: int, r: Random) -> None:
        self.step(slot, a_time(r), a_time(r), r.randrange(-1, 4))

    def step(self, slot: int, t: float, h: float, null: int) -> None:
        model = self.models[slot]
        slack = 1e-6 * h + 1e-12 * abs(t)
        good = model.mode == STEP and null < 0 and 0.0 < h < math.inf
        good = good and abs(t - model.time) <= slack and t + h <= model.stop + slack
        good = good and model.run(ADVANCE, t, h)
        flags, last = [c_bool(True) for _ in range(3)], c_double(-7.0)
        pointers: list[Any] = [*map(byref, flags), byref(last)]
        if null >= 0:
            pointers[null] = None
        self.call("DoStep", slot, c_double(t), c_double(h), c_bool(True), *pointers, good=good)
        if good:
            model.time = t + h
            assert [flag.value for flag in flags] == [False] * 3
            assert last.value == model.time

    # ---- values ----

    def get(self, slot: int, r: Random) -> None:
        model, kind = self.models[slot], r.choice(KINDS)
        vrs = [a_reference(r, OWN[kind]) for _ in range(r.randrange(4))]
        if kind == "Float64" and r.random() < 0.1:
            vrs.append(TIME)
        n = sum(map(count, vrs)) + r.choice([0] * 15 + [1, -1])
        n = max(n, 0)
        good = n == sum(map(count, vrs))
        if model.mode == INITIALIZATION:
            good = model.ensure_started() and good
        good = good and all(model.may_read(vr, kind) for vr in vrs)
        expected = [x for vr in vrs if good for x in model.read(vr)]
        references = (c_uint * max(1, len(vrs)))(*vrs)
        if kind == "Binary":
            sizes, places = (c_size_t * max(1, n))(), (c_void_p * max(1, n))()
            self.call("GetBinary", slot, references, c_size_t(len(vrs)), sizes, places, c_size_t(n), good=good)
            got: list[Any] = [ctypes.string_at(places[i], sizes[i]) for i in range(n if good else 0)]
        else:
            values = (TYPES[kind] * max(1, n))()
            self.call(f"Get{kind}", slot, references, c_size_t(len(vrs)), values, c_size_t(n), good=good)
            got = list(values[:n]) if good else []
        if good:
            shown = [bool(x) if kind == "Boolean" else x for x in expected]
            assert [repr(x) for x in got] == [repr(x) for x in shown], (vrs, got, expected)

    def set(self, slot: int, r: Random) -> None:
        model, kind = self.models[slot], r.choice(KINDS)
        pairs = []
        for _ in range(r.randrange(4)):
            vr = a_reference(r, OWN_SETTABLE[kind])
            pairs.append((vr, [a_value(r, kind) for _ in range(count(vr))]))
        flat = [x for _, values in pairs for x in values]
        n = len(flat)
        if r.randrange(16) == 0:
            flat.append(a_value(r, kind))
        good = model.mode in (INSTANTIATED, INITIALIZATION, STEP) and len(flat) == n
        good = good and all(model.may_set(vr, kind, values) for vr, values in pairs)
        references = (c_uint * max(1, len(pairs)))(*(vr for vr, _ in pairs))
        n = len(flat)
        if kind == "Binary":
            sizes = (c_size_t * max(1, n))(*map(len, flat))
            places = (c_char_p * max(1, n))(*flat)
            self.call("SetBinary", slot, references, c_size_t(len(pairs)), sizes, places, c_size_t(n), good=good)
        else:
            values = (TYPES[kind] * max(1, n))(*flat)
            self.call(f"Set{kind}", slot, references, c_size_t(len(pairs)), values, c_size_t(n), good=good)
        if good:
            for vr, given in pairs:
                model.write(vr, given)
            model.started = model.started and model.mode == STEP

    def no_such_type(self, slot: int, r: Random) -> None:
        """The plant has no variable of these types; asking for none of them is no error where values can be read."""
        verb, kind, n = r.choice(["Get", "Set"]), r.choice(["Float32", "UInt8"]), r.randrange(2)
        good = n == 0 and (verb == "Get" or self.models[slot].mode in (INSTANTIATED, INITIALIZATION, STEP))
        values = (TYPES[kind] * 1)()
        self.call(f"{verb}{kind}", slot, (c_uint * 1)(0), c_size_t(n), values, c_size_t(n), good=good)

    def nulls(self, slot: int, r: Random) -> None:
        kind, one = r.choice(KINDS), c_size_t(1)
        arguments = (None, one, None, None, one) if kind == "Binary" else (None, one, None, one)
        self.call(f"{r.choice(['Get', 'Set'])}{kind}", slot, *arguments, good=False)

    # ---- saved states ----

    def get_state(self, slot: int, r: Random) -> None:
        if len(self.states) < 4:
            self.states.append((c_void_p(), {}))
            which = len(self.states) - 1
        else:
            which = r.randrange(4)
        self.call("GetFMUState", slot, byref(self.states[which][0]), good=True)
        self.states[which] = (self.states[which][0], self.models[slot].snapshot())

    def set_state(self, slot: int, r: Random) -> None:
        if self.states:
            state, snapshot = r.choice(self.states)
            self.call("SetFMUState", slot, state, good=True)
            self.models[slot].restore(snapshot)

    def free_state(self, slot: int, r: Random) -> None:
        if self.states:
            state, _ = self.states.pop(r.randrange(len(self.states)))
            self.call("FreeFMUState", slot, byref(state), good=True)
            assert state.value is None

    def serialize(self, slot: int, r: Random) -> None:
        if self.states:
            (state, snapshot), short = r.choice(self.states), r.random() < 0.1
            size = c_size_t()
            self.call("SerializedFMUStateSize", slot, state, byref(size), good=True)
            given = size.value - short
            buffer = ctypes.create_string_buffer(given)
            self.call("SerializeFMUState", slot, state, buffer, c_size_t(given), good=not short)
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
            data = data[:at] + bytes([data[at] ^ r.randrange(1, 256)]) + data[at + 1 :]
        state = c_void_p()
        self.call("DeserializeFMUState", slot, data, c_size_t(len(data)), byref(state), good=damage > 1)
        if damage > 1:
            self.call("SetFMUState", slot, state, good=True)
            self.models[slot].restore(snapshot)
            self.call("FreeFMUState", slot, byref(state), good=True)

    def no_state(self, slot: int, r: Random) -> None:
        name, *arguments = r.choice(
            [
                ("GetFMUState", None),
                ("SetFMUState", None),
                ("SetFMUState", ctypes.create_string_buffer(b"{another}", 64)),
                ("SerializedFMUStateSize", None, byref(c_size_t())),
                ("DeserializeFMUState", None, c_size_t(9), byref(c_void_p())),
            ]
        )
        self.call(name, slot, *arguments, good=False)

    # ---- what is not provided ----

    def not_provided(self, slot: int, r: Random) -> None:
        one = c_size_t(1)
        name, *arguments = r.choice(
            [
                ("EnterEventMode",),
                ("EnterStepMode",),
                ("EnterConfigurationMode",),
                ("GetClock", None, one, None),
                ("GetOutputDerivatives", None, one, None, None, one),
                ("UpdateDiscreteStates", *[None] * 6),
                ("GetIntervalDecimal", None, one, None, None),
                ("GetNumberOfEventIndicators", None),
            ]
        )
        self.call(name, slot, *arguments, good=False)

    def set_debug_logging(self, slot: int, r: Random) -> None:
        names = [r.choice([b"logStatusError"] * 5 + [b"logAll", None]) for _ in range(r.randrange(3))]
        array = (c_char_p * max(1, len(names)))(*names)
        good = all(name == b"logStatusError" for name in names)
        self.call("SetDebugLogging", slot, c_bool(True), c_size_t(len(names)), array, good=good)

    # ---- which of them ----

    WEIGHTS: ClassVar[dict[str, int]] = {
        "enter_initialization_mode": 3,
        "exit_initialization_mode": 3,
        "bring": 3,
        "terminate": 1,
        "reset": 1,
        "instantiate_anything": 1,
        "no_instance": 1,
        "step_on": 8,
        "do_step": 2,
        "get": 20,
        "set": 20,
        "no_such_type": 1,
        "nulls": 1,
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
            if model.mode == STEP:
                vr, value = (c_uint * 3)(X, Y, TIME), (c_double * 3)()
                assert LIBRARY.fmi3GetFloat64(handle, vr, c_size_t(3), value, c_size_t(3)) == OK
                assert [repr(v) for v in value] == [repr(float(v)) for v in (model.m.x, model.m.y, model.time)]

    def teardown(self) -> None:
        for state, _ in self.states:
            assert LIBRARY.fmi3FreeFMUState(self.handles[0], byref(state)) == OK
        for handle in self.handles:
            LIBRARY.fmi3FreeInstance(handle)


def main() -> None:
    LIBRARY.fmi3GetVersion.restype = c_char_p
    assert LIBRARY.fmi3GetVersion() == b"3.0"
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
