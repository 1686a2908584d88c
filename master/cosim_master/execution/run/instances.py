"""The FMU instances of a run, from their creation to their release."""

from __future__ import annotations

from collections.abc import Callable, Collection

from cosim_master.diagnostics.errors import FmuError
from cosim_master.execution.startup.initialize import instantiate
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.fmi.slaves.libraries import Libraries, check_sources
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.system.flatten.flat import CheckedSystem

__all__ = ["Instances"]


class Instances:
    """Owns the instances and their libraries.

    Args:
        isolation: selects the FMUs that run in processes of their own; None: none does.
        opened: called with each library that is loaded.

    Attributes:
        slaves: the instances, in the order of the system.
    """

    def __init__(self, isolation: Isolation | None = None, opened: Callable[[Library], None] | None = None) -> None:
        self.slaves: list[Slave] = []
        self._isolation = isolation
        self._libraries = Libraries(isolation, opened)

    def make(self, checked: CheckedSystem, elsewhere: Collection[int] = ()) -> None:
        """Instantiates all instances of a system, except those with the numbers `elsewhere`.

        Raises:
            SystemDescriptionError: interpreted FMUs are incompatible with each other.
            FmuError: an FMU refuses; `end` frees the others.
        """
        isolation = self._isolation
        own = [one for i, one in enumerate(checked.instances) if i not in elsewhere]
        here = [i for i in own if isolation is None or not isolation.isolates(i.fmu, i.name)]
        check_sources({i.fmu.path: i.fmu for i in here}.values())
        instantiate(checked, self._libraries, self.slaves, elsewhere)

    @property
    def restarts(self) -> tuple[str, ...]:
        """Returns what happened when processes of FMUs were started anew."""
        libraries = {id(one.library): one.library for one in self.slaves}
        return tuple(text for library in libraries.values() for text in library.restarts())

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
