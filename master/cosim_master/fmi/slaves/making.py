"""Creates slaves of all versions of FMI: `fmi1`, `fmi2` and `fmi3` call their functions.

FMUs for Model Exchange are slaves, too: `model_exchange` makes their steps.
"""

from __future__ import annotations

from cosim_master.fmi.description.read import FmuDescription
from cosim_master.fmi.slaves.fmi1 import Instance1, Library1
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.fmi3 import Instance3
from cosim_master.fmi.slaves.model_exchange import Exchanged2, Exchanged3
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.fmi.slaves.solvers import Choice

__all__ = ["instantiate"]


def instantiate(
    library: Library,
    name: str,
    fmu: FmuDescription | None = None,
    *,
    early_return: bool = True,
    solver: Choice | None = None,
) -> Slave:
    """Returns a new instance, in the state "instantiated".

    Args:
        fmu: its description, if it differs from that of the library; for FMI 3 only.
        early_return: it may return early from its steps, if it is an FMI 3 instance with this capability.
        solver: the solver of an FMU for Model Exchange.

    Raises:
        FmuError: the FMU refused; its log lines give the reason.
    """
    fmu = fmu or library.fmu
    if fmu.model_exchange is not None:
        exchanged = Exchanged3 if fmu.fmi_version.startswith("3.") else Exchanged2
        return exchanged(library, name, fmu, solver or Choice())
    if isinstance(library, Library1):
        return Instance1(library, name)
    if library.fmu.fmi_version.startswith("3."):
        return Instance3(library, name, fmu, early_return=early_return)
    return library.instantiate(name)
