"""Instances made of Python functions, and systems made of them: the master's loop without FMUs.

A `Scripted` has the FMI functions that the loop calls, as ctypes callbacks. It writes down every call in a list that
all instances of a test share, so a test can spell out a macro step literally.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import FmuError, Where
from cosim_master.fmi.calls import CallMemory, Calls2
from cosim_master.fmi.description.read import Capabilities, FmuDescription, Variable
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance, FlatConnection
from cosim_master.system.structure import System, SystemStructure

_REFERENCES, _SIZE, _HANDLE = ctypes.POINTER(ctypes.c_uint), ctypes.c_size_t, ctypes.c_void_p
_TYPES = {"Real": ctypes.c_double, "Integer": ctypes.c_int, "Boolean": ctypes.c_int, "String": ctypes.c_char_p}
HERE = Where("scripted")


def variable(
    name: str, causality: str, type: str = "Real", reference: int = 0, capacity: int | None = None
) -> Variable:
    variability = "continuous" if type == "Real" else "discrete"
    initial = None if causality == "input" else "calculated"
    return Variable(name, reference, type, causality, variability, initial, packet_capacity=capacity)


class Scripted:
    """One instance: `do_step(self, t, h)` may read and write `self.values` by variable name, and returns a status."""

    def __init__(
        self,
        name: str,
        variables: Sequence[Variable],
        do_step: Callable[[Scripted, float, float], int | None],
        values: Mapping[str, Any],
        log: list[str],
        step_size: float = 1.0,
        variable_step: bool = True,
    ) -> None:
        self.name = name
        self.handle = id(self) & 0x7FFFFFFFFFFF
        self.values: dict[str, Any] = dict(values)
        self.log = log
        self.lines: list[str] = []
        self.library = self
        self.resources = Path("nowhere")
        self.python = self.isolated = False
        self.event_mode, self.pending, self.next_event = False, 0, float("inf")
        self.has_answers = self.initializes_anew = False
        self.time: float | None = None
        named = {v.name: v for v in variables}
        capabilities = Capabilities(canHandleVariableCommunicationStepSize=variable_step)
        self.fmu = FmuDescription(
            Path(f"{name}.fmu"),
            "0" * 64,
            "2.0",
            name,
            name,
            "guid",
            "",
            "lib",
            named,
            {},
            step_size,
            capabilities,
            {},
            {},
        )
        self.instance = ComponentInstance(name, self.fmu, {}, step_size, HERE)
        self._by_reference = {(_kind(v), v.value_reference): v.name for v in variables}
        self._functions: dict[str, Any] = {}
        self._kept: dict[str, bytes] = {}
        for kind, c_type in _TYPES.items():
            self._define(f"fmi2Get{kind}", self._getter(kind), _HANDLE, _REFERENCES, _SIZE, ctypes.POINTER(c_type))
            self._define(f"fmi2Set{kind}", self._setter(kind), _HANDLE, _REFERENCES, _SIZE, ctypes.POINTER(c_type))

        def step(_: int, t: float, h: float, __: int) -> int:
            self.log.append(f"{self.name}: doStep {t:g} + {h:g}")
            return do_step(self, t, h) or 0

        self._define("fmi2DoStep", step, _HANDLE, ctypes.c_double, ctypes.c_double, ctypes.c_int)

    def use_answers(self, address: int) -> None:
        assert address == 0, "a step of FMI 2 answers a status only"

    def _define(self, name: str, function: Callable[..., int], *types: Any) -> None:
        self._functions[name] = ctypes.CFUNCTYPE(ctypes.c_int, *types)(function)

    def _getter(self, kind: str) -> Callable[..., int]:
        def get(_: int, references: Any, n: int, out: Any) -> int:
            names = [self._by_reference[kind, references[i]] for i in range(n)]
            for i, name in enumerate(names):
                value = self.values[name]
                if kind == "String":
                    self._kept[name] = value.encode()
                    value = self._kept[name]
                out[i] = value
            self.log.append(f"{self.name}: get {' '.join(names)}")
            return int(self.values.get("get status", 0))

        return get

    def _setter(self, kind: str) -> Callable[..., int]:
        def set_values(_: int, references: Any, n: int, values: Any) -> int:
            for i in range(n):
                name = self._by_reference[kind, references[i]]
                value = values[i].decode() if kind == "String" else values[i]
                self.values[name] = value
                self.log.append(f"{self.name}: set {name} = {value}")
            return int(self.values.get("set status", 0))

        return set_values

    def address(self, function: str) -> int:
        return ctypes.cast(self._functions[function], ctypes.c_void_p).value or 0

    def address_if(self, function: str) -> int:
        return self.address(function) if function in self._functions else 0

    def calls(self, memory: CallMemory) -> Calls2:
        return Calls2(self.address, self.handle, memory)

    def step_address(self) -> int:
        return self.address("fmi2DoStep")

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        words = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal")
        return FmuError(self.name, function, detail or words[status], self.time, self.lines)


def _kind(v: Variable) -> str:
    return "Integer" if v.type == "Enumeration" else v.type


def system_of(
    instances: Sequence[Scripted],
    links: Sequence[tuple[Any, ...]] = (),
    stop_time: float | None = None,
) -> CheckedSystem:
    """A checked system of scripted instances; a link is ("a.y", "b.u"[, factor, offset[, mapping]])."""
    made = []
    for link in links:
        source, target = (tuple(end.rsplit(".", 1)) for end in link[:2])
        factor, offset, mapping = (*link[2:], *(1.0, 0.0, ())[len(link) - 2 :])
        made.append(FlatConnection(source, target, factor, offset, False, HERE, mapping))  # type: ignore[arg-type]
    system = System("root", (), (), (), (), (), Path("scripted.ssd"), HERE)
    structure = SystemStructure("scripted", "1.0", Path("scripted.ssd"), Path("scripted.ssd"), system, HERE)
    ordered = tuple(sorted((one.instance for one in instances), key=lambda i: i.name))
    return CheckedSystem(structure, ordered, tuple(made), 0.0, stop_time, (), (), (), (), ())
