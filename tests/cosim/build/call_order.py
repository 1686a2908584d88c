"""Any FMI calls in any order on a compiled Plant (sample_models.py), through ctypes, against a model in Python.

The model has the state table of the standard, and the record with the kernels run as plain Python. It says of every
call whether it succeeds and what it returns; one that must not succeed is an error with a logged message. The calls and
variables of a version of FMI are in call_order_fmi2.py and call_order_fmi3.py, which run as scripts in a process of
their own: a crash is then the end of a process.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import sys
from ctypes import byref, c_char_p, c_size_t, c_void_p
from pathlib import Path
from random import Random
from typing import Any, ClassVar

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test

OK, ERROR = 0, 3
INSTANTIATED, INITIALIZATION, STEP, TERMINATED, FAILED = "instantiated", "initialization", "step", "end", "error"
SETTABLE = {INSTANTIATED, INITIALIZATION, STEP}
SET_BY_ENVIRONMENT = ("parameter", "input", "packet input")
ODD_FLOATS = [0.0, 1.0, 2.5, 10.0, 10.5, -1.0, math.nan, math.inf, -math.inf, 1e308, 5e-324]
ODD_INTEGERS = [0, 4, 5, 7, -1, 1000, 1001, 2**31 - 1, -(2**31)]

LOG: list[tuple[int, bytes, bytes]] = []
"""Status, category and text of each message since the last call began."""
LIBRARY = ctypes.CDLL(sys.argv[1])
GUID = sys.argv[2].encode()


def plant() -> Any:
    file = Path(__file__).parents[1] / "sample_models.py"
    spec = importlib.util.spec_from_file_location("sample_models", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["sample_models"] = module
    spec.loader.exec_module(module)
    return module.Plant


PLANT = plant()
from cosim.model import record_layout  # noqa: E402

DTYPE, HEAD = record_layout(PLANT.variables)
START, ADVANCE = (getattr(kernel, "py_func", kernel) for kernel in PLANT.kernels)
PLAIN = sys.modules["sample_models"]
PLAIN.publish = getattr(PLAIN.publish, "py_func", PLAIN.publish)  # type: ignore[attr-defined]
DEFAULTS = PLANT.record().tobytes()


def a_time(r: Random) -> float:
    return r.choice([0.0, 0.125, 0.5, -1.0, math.nan, math.inf, 1e300, r.uniform(-2.0, 2.0)])


class Model:
    """The expected state of an instance."""

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

    def may_change(self, variable: Any) -> bool:
        """Returns whether a value of the variable may be set now."""
        fixed = variable.role == "parameter" and not variable.tunable
        return variable.role in SET_BY_ENVIRONMENT and not (fixed and self.mode == STEP)


class Calls(RuleBasedStateMachine):
    """Two instances and the states saved from them.

    A version of FMI has these names and types, and further calls (with their weights).
    """

    PREFIX: ClassVar[str]
    STATE: ClassVar[str]
    DESERIALIZE: ClassVar[str]
    BOOLEAN: ClassVar[Any]
    MODEL: ClassVar[type[Model]] = Model

    def __init__(self) -> None:
        super().__init__()
        self.handles = [self.instantiate() for _ in range(2)]
        self.models = [self.MODEL() for _ in range(2)]
        self.done = 0
        self.states: list[tuple[c_void_p, dict[str, Any]]] = []
        self.stored: list[tuple[bytes, dict[str, Any]]] = []
        assert all(self.handles)
        LOG.clear()

    def call(self, name: str, slot: int, *arguments: Any, good: bool) -> None:
        LOG.clear()
        status = int(getattr(LIBRARY, f"{self.PREFIX}{name}")(self.handles[slot], *arguments))
        assert status == (OK if good else ERROR), (name, status, self.models[slot].mode, LOG)
        if good:
            assert LOG == [], (name, LOG)
        else:
            assert len(LOG) == 1, (name, LOG)
            assert LOG[0][:2] == (ERROR, b"logStatusError")
            assert len(LOG[0][2]) > 10
            self.models[slot].mode = FAILED

    def function(self, name: str) -> Any:
        return getattr(LIBRARY, f"{self.PREFIX}{name}")

    def instantiate(self) -> Any:
        raise NotImplementedError

    def begin(self, slot: int) -> None:
        """Goes from the state after instantiation to Initialization Mode, at time 0."""
        raise NotImplementedError

    def step(self, slot: int, t: float, h: float, null: int) -> None:
        """Makes a step; `null` is the number of a pointer that is NULL, or negative."""
        raise NotImplementedError

    def published(self, handle: Any) -> list[float]:
        """Returns the values of x and y."""
        raise NotImplementedError

    # ---- life cycle ----

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
            self.begin(slot)
        if to in (STEP, TERMINATED):
            self.exit_initialization_mode(slot, r)
        if to == TERMINATED:
            self.terminate(slot, r)

    def terminate(self, slot: int, r: Random) -> None:
        model = self.models[slot]
        good = model.mode == STEP
        self.call("Terminate", slot, good=good)
        if good:
            model.mode = TERMINATED

    def reset(self, slot: int, r: Random) -> None:
        self.call("Reset", slot, good=True)
        self.models[slot].reset()

    def free_and_instantiate(self, slot: int, r: Random) -> None:
        self.function("FreeInstance")(self.handles[slot])
        self.handles[slot] = self.instantiate()
        assert self.handles[slot]
        self.models[slot].reset()

    def no_instance(self, slot: int, r: Random) -> None:
        self.function("FreeInstance")(None)
        assert self.function(r.choice(["Terminate", "Reset", "ExitInitializationMode"]))(None) == ERROR

    # ---- stepping ----

    def step_on(self, slot: int, r: Random) -> None:
        self.step(slot, self.models[slot].time, r.choice([0.125, 0.25, 0.1]), -1)

    def do_step(self, slot: int, r: Random) -> None:
        self.step(slot, a_time(r), a_time(r), r.randrange(-1, 4))

    def steps(self, slot: int, t: float, h: float) -> bool:
        """Makes a step of the model; returns whether it succeeds."""
        model, slack = self.models[slot], 1e-6 * h + 1e-12 * abs(t)
        good = model.mode == STEP and 0.0 < h < math.inf
        good = good and abs(t - model.time) <= slack and t + h <= model.stop + slack
        if good := good and model.run(ADVANCE, t, h):
            model.time = t + h
        return good

    # ---- saved states ----

    def get_state(self, slot: int, r: Random) -> None:
        """Into a new state, or into an existing one."""
        if len(self.states) < 4:
            state = c_void_p()
            self.states.append((state, {}))
            which = len(self.states) - 1
        else:
            which = r.randrange(4)
        self.call(f"Get{self.STATE}", slot, byref(self.states[which][0]), good=True)
        self.states[which] = (self.states[which][0], self.models[slot].snapshot())

    def set_state(self, slot: int, r: Random) -> None:
        if self.states:
            state, snapshot = r.choice(self.states)
            self.call(f"Set{self.STATE}", slot, state, good=True)
            self.models[slot].restore(snapshot)

    def free_state(self, slot: int, r: Random) -> None:
        if self.states:
            state, _ = self.states.pop(r.randrange(len(self.states)))
            self.call(f"Free{self.STATE}", slot, byref(state), good=True)
            assert state.value is None
            self.call(f"Free{self.STATE}", slot, byref(state), good=True)

    def serialize(self, slot: int, r: Random) -> None:
        if self.states:
            (state, snapshot), short = r.choice(self.states), r.random() < 0.1
            size = c_size_t()
            self.call(f"Serialized{self.STATE}Size", slot, state, byref(size), good=True)
            given = size.value - short
            buffer = ctypes.create_string_buffer(given)
            self.call(f"Serialize{self.STATE}", slot, state, buffer, c_size_t(given), good=not short)
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
        self.call(self.DESERIALIZE, slot, data, c_size_t(len(data)), byref(state), good=damage > 2)
        if damage > 2:
            self.call(f"Set{self.STATE}", slot, state, good=True)
            self.models[slot].restore(snapshot)
            self.call(f"Free{self.STATE}", slot, byref(state), good=True)

    def no_state(self, slot: int, r: Random) -> None:
        name, good, *arguments = r.choice(
            [
                (f"Free{self.STATE}", True, None),
                (f"Get{self.STATE}", False, None),
                (f"Set{self.STATE}", False, None),
                (f"Set{self.STATE}", False, ctypes.create_string_buffer(b"{another}", 64)),
                (f"Serialized{self.STATE}Size", False, None, byref(c_size_t())),
                (f"Serialize{self.STATE}", False, None, None, c_size_t(9)),
                (self.DESERIALIZE, False, None, c_size_t(9), byref(c_void_p())),
            ]
        )
        self.call(name, slot, *arguments, good=good)

    # ---- logging ----

    def set_debug_logging(self, slot: int, r: Random) -> None:
        names = [r.choice([b"logStatusError"] * 5 + [b"logAll", None, b"%n"]) for _ in range(r.randrange(3))]
        null = r.random() < 0.1
        array = (c_char_p * max(1, len(names)))(*names)
        good = all(name == b"logStatusError" for name in names) and not (names and null)
        arguments = (self.BOOLEAN(r.randrange(2)), c_size_t(len(names)), None if null else array)
        self.call("SetDebugLogging", slot, *arguments, good=good)

    # ---- the choice of calls ----

    WEIGHTS: ClassVar[dict[str, int]] = {
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
        """A call changes only the instance that it is for."""
        for handle, model in zip(self.handles, self.models, strict=True):
            if model.mode == STEP:
                assert [repr(v) for v in self.published(handle)] == [repr(float(v)) for v in (model.m.x, model.m.y)]

    def teardown(self) -> None:
        for state, _ in self.states:
            assert self.function(f"Free{self.STATE}")(self.handles[0], byref(state)) == OK
        for handle in self.handles:
            self.function("FreeInstance")(handle)


def main(calls: type[Calls]) -> None:
    run = settings(
        max_examples=int(sys.argv[3]),
        stateful_step_count=10,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    np.seterr(all="ignore")
    run_state_machine_as_test(calls, settings=run)
    print("sequences:", sys.argv[3])
