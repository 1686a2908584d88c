"""Any FMI 3 calls in any order: see call_order.py. The state table is that of FMI 3.0.2, sections 2.3 and 4.2.

Run it as ``python -m tests.cosim.build.call_order_fmi3 LIBRARY TOKEN EXAMPLES``.
"""

from __future__ import annotations

import ctypes
import math
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
from random import Random
from typing import Any, ClassVar

import numpy as np

from cosim.build.description3 import exported
from tests.cosim.build.call_order import (
    GUID,
    INITIALIZATION,
    INSTANTIATED,
    LIBRARY,
    LOG,
    ODD_FLOATS,
    ODD_INTEGERS,
    OK,
    PLANT,
    SET_BY_ENVIRONMENT,
    STEP,
    Calls,
    Model,
    a_time,
    main,
)

TYPES = {"Float64": c_double, "Int32": c_int, "Int64": c_int64, "Boolean": c_bool, "Float32": c_float, "UInt8": c_uint8}
TYPE = {"Real": "Float64", "Integer": "Int32", "Enumeration": "Int64", "Boolean": "Boolean", "Packets": "Binary"}
LOGGER = CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
LOGGING = LOGGER(lambda environment, status, category, text: LOG.append((status, category, text)))
LIBRARY.fmi3InstantiateCoSimulation.restype = c_void_p
VARIABLES = exported(PLANT)
TIME = len(VARIABLES)
Y, X = (next(i for i, v in enumerate(VARIABLES) if v.name == name) for name in "yx")


def count(vr: int) -> int:
    return VARIABLES[vr].shape[0] if vr < TIME and VARIABLES[vr].shape else 1


def instantiate(
    name: bytes | None = b"one",
    token: bytes | None = GUID,
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


KINDS = ["Float64", "Int32", "Int64", "Boolean", "Binary"]
OWN = {kind: [i for i, v in enumerate(VARIABLES) if TYPE[v.kind] == kind] for kind in KINDS}
OWN_SETTABLE = {kind: [i for i in own if VARIABLES[i].role in SET_BY_ENVIRONMENT] for kind, own in OWN.items()}
WRONG = [*range(TIME + 2), 2**31, 2**32 - 1]


def a_reference(r: Random, own: list[int]) -> int:
    return r.choice(own if r.random() < 0.94 else WRONG)


def a_value(r: Random, kind: str) -> Any:
    if kind == "Float64":
        return r.uniform(0.0, 9.0) if r.random() < 0.8 else r.choice(ODD_FLOATS)
    if kind == "Boolean":
        return r.random() < 0.5
    if kind == "Binary":
        return r.randbytes(r.randrange(13)) if r.random() < 0.95 else bytes(2**16)
    wide = [2**40, -(2**40), 2**32 + 2] if kind == "Int64" else []
    return r.choice([1, 2, 3]) if r.random() < 0.7 else r.choice(ODD_INTEGERS + wide)


class Model3(Model):
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
        if vr >= TIME or TYPE[VARIABLES[vr].kind] != kind or not self.may_change(VARIABLES[vr]):
            return False
        v = VARIABLES[vr]
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


class Calls3(Calls):
    PREFIX, STATE, DESERIALIZE, BOOLEAN, MODEL = "fmi3", "FMUState", "DeserializeFMUState", c_bool, Model3
    WEIGHTS: ClassVar[dict[str, int]] = {**Calls.WEIGHTS, "no_such_type": 1, "nulls": 1}
    models: list[Model3]

    def instantiate(self) -> Any:
        return instantiate()

    def begin(self, slot: int) -> None:
        self.enter(slot, 0.0, False, 0.0)

    def enter_initialization_mode(self, slot: int, r: Random) -> None:
        self.enter(slot, a_time(r), r.random() < 0.5, a_time(r))

    def enter(self, slot: int, start: float, has_stop: bool, stop: float) -> None:
        model = self.models[slot]
        good = model.mode == INSTANTIATED and math.isfinite(start) and (not has_stop or stop >= start)
        arguments = (c_bool(False), c_double(0.0), c_double(start), c_bool(has_stop), c_double(stop))
        self.call("EnterInitializationMode", slot, *arguments, good=good)
        if good:
            model.mode, model.time, model.stop = INITIALIZATION, start, stop if has_stop else math.inf

    def instantiate_anything(self, slot: int, r: Random) -> None:
        name, token = r.choice([None, b"", b"one", b"x" * 2**16]), r.choice([None, b"", GUID, GUID, b"%n" * 600])
        events, needed = r.random() < 0.2, r.choice([0, 0, 0, 1])
        LOG.clear()
        handle = instantiate(name, token, events, needed)
        good = bool(name) and token == GUID and not events and not needed
        assert (handle is not None) == good
        assert len(LOG) == (not good)
        if handle is not None:
            LIBRARY.fmi3FreeInstance(handle)

    def step(self, slot: int, t: float, h: float, null: int) -> None:
        good = null < 0 and self.steps(slot, t, h)
        flags, last = [c_bool(True) for _ in range(3)], c_double(-7.0)
        pointers: list[Any] = [*map(byref, flags), byref(last)]
        if null >= 0:
            pointers[null] = None
        self.call("DoStep", slot, c_double(t), c_double(h), c_bool(True), *pointers, good=good)
        if good:
            assert [flag.value for flag in flags] == [False] * 3
            assert last.value == self.models[slot].time

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

    def published(self, handle: Any) -> list[float]:
        vr, value = (c_uint * 2)(X, Y), (c_double * 2)()
        assert LIBRARY.fmi3GetFloat64(handle, vr, c_size_t(2), value, c_size_t(2)) == OK
        return list(value)


if __name__ == "__main__":
    LIBRARY.fmi3GetVersion.restype = c_char_p
    assert LIBRARY.fmi3GetVersion() == b"3.0"
    main(Calls3)
