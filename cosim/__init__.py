"""What a model author imports: declared ports, kernels, and what crosses the boundary of an FMU."""

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
