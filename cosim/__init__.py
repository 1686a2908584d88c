"""The public names for model authors: variable declarations, kernels, and the types that cross an FMU's boundary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cosim.kernel import kernel

if TYPE_CHECKING:
    from cosim.model import (
        Input,
        Memory,
        Model,
        Output,
        PacketInput,
        PacketOutput,
        Parameter,
        State,
        Variable,
    )

__all__ = [
    "Input",
    "Memory",
    "Model",
    "Output",
    "PacketInput",
    "PacketOutput",
    "Parameter",
    "State",
    "Variable",
    "kernel",
]


def __getattr__(name: str) -> Any:
    """Imports the declarations when they are first used: a run loads FMUs, and no models."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from cosim import model

    return globals().setdefault(name, getattr(model, name))
