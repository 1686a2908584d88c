"""The public names for model authors: variable declarations, kernels, and the types that cross an FMU's boundary."""

from cosim.kernel import kernel
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
