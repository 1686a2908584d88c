"""Living instances of either version of FMI, which have one interface: `fmi2` and `fmi3` call their functions."""

from __future__ import annotations

from typing import TypeAlias

from cosim_master.fmi2 import Instance, Library
from cosim_master.fmi3 import Instance3
from cosim_master.fmu import FmuDescription

__all__ = ["Living", "instantiate"]

Living: TypeAlias = Instance | Instance3


def instantiate(library: Library, name: str, fmu: FmuDescription | None = None, *, early_return: bool = True) -> Living:
    """A new instance, in the state "instantiated".

    Args:
        fmu: its description, if it is not that of the library; of FMI 3 only.
        early_return: let it return early from its steps, if it is of FMI 3 and able to.

    Raises:
        FmuError: the FMU refused; its log lines say why.
    """
    if library.fmu.fmi_version.startswith("3."):
        return Instance3(library, name, fmu, early_return=early_return)
    return library.instantiate(name)
