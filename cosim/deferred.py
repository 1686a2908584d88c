"""Parts of kernels that are made when a kernel is compiled, because they need numba.

numba takes as long to import as everything else that a short run does. Programs that find machine code of their kernels
(`cosim.entry`) never compile one, so they never import it. Modules with kernels therefore hold stand-ins: of kernels,
and of functions that exist in compiled code only. Whoever compiles a kernel replaces the stand-ins that it names
(`cosim.shortcuts`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any

__all__ = ["Deferred", "InModule", "compiled", "on_compilation"]

on_compilation: list[Callable[[Callable[..., Any], bool], None]] = []
"""Called with the Python function of each kernel for which machine code is made: with True before, with False after."""


class Deferred(ABC):
    """A stand-in for something that numba compiles."""

    @property
    @abstractmethod
    def compiled(self) -> Any:
        """The object for which this one stands, as numba knows it."""


class InModule(Deferred):
    """The stand-in for a name of a module that imports numba.

    Args:
        module: imports the module and returns it. A digest of sources covers modules that the text imports.
    """

    def __init__(self, module: Callable[[], Any], name: str) -> None:
        self._module, self._name = cache(module), name

    @property
    def compiled(self) -> Any:
        return getattr(self._module(), self._name)


def compiled(value: Any) -> Any:
    """Returns the object for which `value` stands, also within a tuple; other values as they are."""
    if isinstance(value, Deferred):
        return value.compiled
    if type(value) is tuple and any(isinstance(one, Deferred) for one in value):
        return tuple(map(compiled, value))
    return value
