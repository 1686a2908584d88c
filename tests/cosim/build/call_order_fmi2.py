"""Any FMI 2 calls in any order: see call_order.py. The state table is that of FMI 2.0.5, section 4.2.4.

Run it as ``python -m tests.cosim.build.call_order_fmi2 LIBRARY GUID EXAMPLES``.
"""

from __future__ import annotations

import base64
import math
from ctypes import CFUNCTYPE, Structure, byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from random import Random
from typing import Any, ClassVar

import numpy as np

from cosim.model import flat_variables
from tests.cosim.build.call_order import (
    ERROR,
    FAILED,
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
    SETTABLE,
    STEP,
    TERMINATED,
    Calls,
    Model,
    a_time,
    main,
)

READABLE = {INITIALIZATION, STEP, TERMINATED, FAILED}
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


CALLBACKS = Callbacks(LOGGER(lambda env, name, status, category, text: LOG.append((status, category, text))))
LIBRARY.fmi2Instantiate.restype = c_void_p
FLAT = flat_variables(PLANT.variables)
OWN = {kind: [i for i, one in enumerate(FLAT) if KIND[one.variable.kind] == kind] for kind in TYPES}
OWN_SETTABLE = {kind: [i for i in own if FLAT[i].variable.role in SET_BY_ENVIRONMENT] for kind, own in OWN.items()}
KINDS = sorted(TYPES)
WRONG_REFERENCES = [*range(len(FLAT)), len(FLAT), 2**31, 2**32 - 1]
ODD_TEXTS = [None, b"", b"=", b"A", b"AA", b"AAA", b"A===", b"AA=A", b"AA==AAAA", b"AA AA", b"\xff\xfe\xfd\xfc"]
LONG_TEXTS = [b"A" * 2**20, b"%n%s%x" * 1000, b"=" * 4096]
LONG_NAMES = [b"%s%n" * 99, b"x" * 2**20]


def a_reference(r: Random, own: list[int]) -> int:
    """Mostly one of `own`; sometimes any, or none that there is."""
    return r.choice(own if r.random() < 0.93 else WRONG_REFERENCES)


def a_value(r: Random, kind: str) -> Any:
    if kind == "Real":
        return r.uniform(0.0, 9.0) if r.random() < 0.7 else r.choice(ODD_FLOATS)
    if kind == "Integer":
        return r.choice([1, 2, 3]) if r.random() < 0.7 else r.choice(ODD_INTEGERS)
    if kind == "Boolean":
        return r.choice([0, 1, -1, 7])
    if r.random() < 0.6:
        return base64.b64encode(r.randbytes(r.randrange(13)))
    return r.choice(ODD_TEXTS) if r.random() < 0.97 else r.choice(LONG_TEXTS)


def instantiate(
    name: bytes | None = b"one", kind: int = 1, guid: bytes | None = GUID, callbacks: Any = CALLBACKS
) -> Any:
    pointer = None if callbacks is None else byref(callbacks)
    handle = LIBRARY.fmi2Instantiate(c_char_p(name), kind, c_char_p(guid), None, pointer, 0, 1)
    return None if handle is None else c_void_p(handle)


class Model2(Model):
    experiment = False

    def reset(self) -> None:
        super().reset()
        self.experiment = False

    def read(self, vr: int) -> Any:
        one = FLAT[vr]
        value = self.m[one.variable.name]
        if one.variable.kind == "Packets":
            return base64.b64encode(value[: self.m[f"{one.variable.name}_len"]].tobytes())
        return (value if one.index is None else value[one.index]).item()

    def may_set(self, vr: int, value: Any) -> bool:
        variable = FLAT[vr].variable
        if not self.may_change(variable):
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


class Calls2(Calls):
    PREFIX, STATE, DESERIALIZE, BOOLEAN, MODEL = "fmi2", "FMUstate", "DeSerializeFMUstate", c_int, Model2
    WEIGHTS: ClassVar[dict[str, int]] = {**Calls.WEIGHTS, "setup_experiment": 2, "get_status": 3}
    models: list[Model2]

    def instantiate(self) -> Any:
        return instantiate()

    def begin(self, slot: int) -> None:
        self.set_up(slot, 0.0, False, 0.0)
        self.enter_initialization_mode(slot, Random(0))

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

    def step(self, slot: int, t: float, h: float, null: int) -> None:
        good = self.steps(slot, t, h)
        self.call("DoStep", slot, c_double(t), c_double(h), 1, good=good)

    def get_status(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        name, null = r.choice(["", "Real", "Integer", "Boolean", "String"]), r.random() < 0.1
        right = {"": 0, "String": 1, "Real": 2, "Boolean": 3}.get(name)
        kind = right if right is not None and r.random() < 0.7 else r.randrange(-1, 5)
        value: Any = {"Real": c_double(7.0), "String": c_char_p(b"?")}.get(name, c_int(7))
        good = model.mode in (STEP, TERMINATED, FAILED) and kind == right and not null
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
            model.started = model.started and model.mode == STEP

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

    def published(self, handle: Any) -> list[float]:
        vr, value = (c_uint * 2)(9, 0), (c_double * 2)()
        assert LIBRARY.fmi2GetReal(handle, vr, c_size_t(2), value) == OK
        return list(value)


if __name__ == "__main__":
    LIBRARY.fmi2GetVersion.restype = LIBRARY.fmi2GetTypesPlatform.restype = c_char_p
    assert (LIBRARY.fmi2GetVersion(), LIBRARY.fmi2GetTypesPlatform()) == (b"2.0", b"default")
    main(Calls2)
