"""The FMU instances of a run, from their creation to their release."""

from __future__ import annotations

from cosim_master.diagnostics.errors import FmuError
from cosim_master.execution.startup.initialize import instantiate
from cosim_master.fmi.slaves.libraries import Libraries, check_sources
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.system.flatten.flat import CheckedSystem

__all__ = ["Instances"]


class Instances:
    """Owns the instances and their libraries.

    Attributes:
        slaves: the instances, in the order of the system.
    """

    def __init__(self) -> None:
        self.slaves: list[Slave] = []
        self._libraries = Libraries()

    def make(self, checked: CheckedSystem) -> None:
        """Instantiates all instances of a system.

        Raises:
            SystemDescriptionError: interpreted FMUs are incompatible with each other.
            FmuError: an FMU refuses; `end` frees the others.
        """
        check_sources({i.fmu.path: i.fmu for i in checked.instances}.values())
        instantiate(checked, self._libraries, self.slaves)

    def end(self) -> list[FmuError]:
        """Terminates and frees all instances, each once, even if others fail; returns the errors."""
        failures = []
        for one in self.slaves:
            try:
                one.terminate()
            except FmuError as error:
                failures.append(error)
        for one in self.slaves:
            try:
                one.free()
            except FmuError as error:
                failures.append(error)
        self._libraries.__exit__(None, None, None)
        return failures
