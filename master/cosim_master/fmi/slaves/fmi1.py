"""FMI 1.0 co-simulation slaves, with the interface of `fmi2`.

Functions are called "{modelIdentifier}_fmi...". FMI 1.0 has no initialization mode: start values of parameters and
inputs are set first, and fmiInitializeSlave is called when the first output is requested. The values from connections
are set after it. Booleans are one byte, and three functions are called through Python: the loop's calls are those of
FMI 2.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.slaves.fmi2 import CALLBACK_TYPES, Instance2, Library

__all__ = ["Instance1", "Library1"]

_NAMES = {"Terminate": "TerminateSlave", "FreeInstance": "FreeSlaveInstance"}
_BOOLEANS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
_MIME_TYPE = b"application/x-fmu-sharedlibrary"


class _Callbacks(ctypes.Structure):
    _fields_ = (
        *zip(("logger", "allocateMemory", "freeMemory"), CALLBACK_TYPES, strict=True),
        ("stepFinished", ctypes.c_void_p),
    )


class Library1(Library):
    """The loaded binary of one FMU of FMI 1.0; functions are identified by their FMI 2 names."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        set_boolean, get_boolean = (
            super()._function(self._named("SetBoolean")),
            super()._function(self._named("GetBoolean")),
        )
        step = super()._function(self._named("DoStep"))

        def set_booleans(handle: int, references: int, n: int, values: int) -> int:
            given = (ctypes.c_int * n).from_address(values)
            narrow = (ctypes.c_byte * n)(*(1 if value else 0 for value in given))
            place = ctypes.c_void_p(references)
            return int(set_boolean(ctypes.c_void_p(handle), place, ctypes.c_size_t(n), narrow))

        def get_booleans(handle: int, references: int, n: int, values: int) -> int:
            narrow = (ctypes.c_byte * n)()
            place = ctypes.c_void_p(references)
            status = int(get_boolean(ctypes.c_void_p(handle), place, ctypes.c_size_t(n), narrow))
            (ctypes.c_int * n).from_address(values)[:] = [1 if value else 0 for value in narrow]
            return status

        def do_step(handle: int, t: float, h: float, _final: int) -> int:
            # newStep: FMI 1.0 slaves cannot go back, so each step is a new one.
            arguments = (ctypes.c_double(t), ctypes.c_double(h), ctypes.c_byte(1))
            return int(step(ctypes.c_void_p(handle), *arguments))

        self._own = {
            "SetBoolean": _BOOLEANS(set_booleans),
            "GetBoolean": _BOOLEANS(get_booleans),
            "DoStep": _STEP(do_step),
        }

    def _named(self, name: str) -> str:
        name = re.sub("^fmi[12]", "", name)
        return f"{self.fmu.model_identifier}_fmi{_NAMES.get(name, name)}"

    def _function(self, name: str) -> Any:
        return self._own.get(re.sub("^fmi[12]", "", name)) or super()._function(self._named(name))

    def has(self, *functions: str) -> bool:
        return super().has(*map(self._named, functions))


class Instance1(Instance2):
    """A slave of FMI 1.0."""

    _instantiates = "fmiInstantiateSlave"

    def __init__(self, library: Library1, name: str) -> None:
        self._initialized = False
        self._span = (0.0, 0.0)
        super().__init__(library, name, *library.memory)

    def _instantiate(self, allocate: Any, free: Any) -> int:
        library, fmu = self.library, self.fmu
        self._callbacks1 = _Callbacks(self._logger, allocate, free, None)
        instantiate = library.function("fmi2InstantiateSlave", self.name)
        instantiate.restype = ctypes.c_void_p
        handle = instantiate(
            ctypes.c_char_p(self.name.encode()),
            ctypes.c_char_p(fmu.guid.encode()),
            ctypes.c_char_p(library.resources.parent.as_uri().encode()),
            ctypes.c_char_p(_MIME_TYPE),
            ctypes.c_double(0.0),
            ctypes.c_byte(0),
            ctypes.c_byte(0),
            self._callbacks1,
            ctypes.c_byte(0),
        )
        return int(handle or 0)

    def call(self, function: str, *arguments: Any) -> None:
        kind = function.removeprefix("fmi2")
        if kind.endswith("Boolean"):
            references, n, values = arguments
            status = int(
                self.library.function(function, self.name)(
                    self.handle, ctypes.addressof(references), n.value, ctypes.addressof(values)
                )
            )
            if status > 1:
                raise self.failure(function, status)
            return
        super().call(function, *arguments)

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        error = super().failure(function, status, detail)
        function, words = (text.replace("fmi2", "fmi") for text in (error.function, error.status))
        return FmuError(error.instance, function, words, error.time, error.log)

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        self._initialize()
        return super().get(variables)

    def setup_experiment(self, start: float, stop: float) -> None:
        self.time = start
        self._span = (start, stop)

    def enter_initialization_mode(self) -> None:
        pass

    def exit_initialization_mode(self) -> None:
        self._initialize()
        self.stepping = True

    def _initialize(self) -> None:
        if not self._initialized:
            self._initialized = True
            start, stop = self._span
            self.call("fmi2InitializeSlave", ctypes.c_double(start), ctypes.c_byte(1), ctypes.c_double(stop))

    def ended(self) -> bool:
        """Returns False after a discarded step, which in FMI 1.0 never requests the end of the simulation."""
        return False
