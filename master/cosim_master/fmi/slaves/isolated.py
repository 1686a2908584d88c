"""FMUs whose functions run in a process of their own: libraries with the interface of `fmi2.Library`."""

from __future__ import annotations

import ctypes
import hashlib
import json
import logging
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal

from cosim.identity import guid_of
from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import FmuDescription, runner
from cosim_master.fmi.isolation.building import CannotIsolate, portable, shares_memory
from cosim_master.fmi.isolation.child import Child, Limits, Process
from cosim_master.fmi.isolation.remote import Address
from cosim_master.fmi.isolation.runner import Runner
from cosim_master.fmi.slaves.fmi2 import Diagnosis, Library

__all__ = ["IsolatedLibrary", "Isolation", "Scope", "built_here", "changed_source", "isolable"]

log = logging.getLogger(__name__)

_ERROR, _FATAL = 3, 4
_WINDOWS = "x86_64-windows-gnu"
_STATES = {
    "2": [f"fmi2{verb}FMUstate" for verb in ("Get", "Set", "Free", "Serialize", "DeSerialize")]
    + ["fmi2SerializedFMUstateSize"],
    "3": [f"fmi3{verb}FMUState" for verb in ("Get", "Set", "Free", "Serialize", "Deserialize")]
    + ["fmi3SerializedFMUStateSize"],
}
"""The functions that a restart needs, by major version of FMI."""
Scope = Literal["none", "foreign", "instance", "all"]


@dataclass(frozen=True, slots=True)
class Isolation:
    """Selects the FMUs that run in processes of their own.

    Attributes:
        scope: "none"; "foreign": all FMUs that this project has not built, one process per FMU file; "instance": the
            same, one process per instance; "all": every FMU.
        limits: of each process.
        wishes: the processes that a system sets for instances, which precede `scope`: "here", "file" or "instance".
        restarts: how often the processes of instances are started anew, where that differs from `limits`.
        hosts: the machines of instances whose processes are not on this one, by name; as the user wants it, by
            pattern. They precede everything else.
        token: the secret of these machines.
    """

    scope: Scope = "foreign"
    limits: Limits = field(default_factory=Limits)
    wishes: Mapping[str, str] = field(default_factory=dict)
    restarts: Mapping[str, int] = field(default_factory=dict)
    hosts: Mapping[str, Address] = field(default_factory=dict)
    token: str = field(default="", repr=False)

    def isolates(self, fmu: FmuDescription, name: str = "") -> bool:
        """Returns whether the instance `name` of an FMU runs in another process."""
        if not isolable(fmu):
            return False
        if name in self.hosts or run_by_another(fmu):
            return True
        if wish := self.wishes.get(name):
            return wish != "here"
        return self.scope == "all" or (self.scope != "none" and not built_here(fmu))

    def each(self, fmu: FmuDescription, name: str = "") -> bool:
        """Returns whether an isolated instance has a process of its own, instead of one for its file."""
        wish = self.wishes.get(name) or self.scope
        return wish == "instance" or fmu.capabilities.canBeInstantiatedOnlyOncePerProcess

    def limits_of(self, name: str) -> Limits:
        """Returns the limits of the process of an instance."""
        return replace(self.limits, restarts=self.restarts.get(name, self.limits.restarts))


_OWN_PACKAGES = ("cosim", "cosim_models")


def built_here(fmu: FmuDescription) -> bool:
    """Returns whether this project has built an FMU: it says so, and its GUID is that of the sources it lists."""
    if fmu.generation_tool != "uav-cosim" or fmu.table is not None:
        return False
    listed = _listed_sources(fmu.path, fmu.digest)
    with suppress(TypeError, ValueError, AttributeError):  # a list that is none
        return listed is not None and fmu.guid == guid_of(fmu.model_name, listed)
    return False


@lru_cache(maxsize=256)
def _listed_sources(file: Path, _digest: str) -> dict[str, str] | None:
    """Returns the modules that an FMU was built from, by name, with their digests; None without such a list.

    Each file is opened once for each digest of it, since a swarm asks for every instance.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            return dict(json.loads(archive.read("resources/build.json"))["sources"])
    except (OSError, KeyError, TypeError, ValueError, AttributeError, zipfile.BadZipFile):
        return None


def changed_source(fmu: FmuDescription) -> Path | None:
    """Returns the file of an FMU's model that has changed since the FMU was built; None if none is known.

    It is looked for by its name in the folder of the FMU, in the one above, and in the working directory, and must
    declare the model.
    """
    if not built_here(fmu):
        return None
    places = (fmu.path.parent, fmu.path.parent.parent, Path())
    for module, digest in (_listed_sources(fmu.path, fmu.digest) or {}).items():
        if "." in module or module in _OWN_PACKAGES:
            continue
        files = [place / f"{module}.py" for place in places]
        contents = {file: file.read_bytes() for file in files if file.is_file()}
        if any(hashlib.sha256(content).hexdigest() == digest for content in contents.values()):
            continue
        for file, content in contents.items():
            if f"class {fmu.model_name}(".encode() in content:
                return file
    return None


def isolable(fmu: FmuDescription) -> bool:
    """Returns whether an FMU can run in a process: FMI 2 and 3, and not a table."""
    return fmu.table is None and not fmu.fmi_version.startswith("1")


def run_by_another(fmu: FmuDescription) -> bool:
    """Returns whether the binary of an FMU is for Windows, and this is not: a program such as Wine runs it."""
    return fmu.library.endswith(".dll") and sys.platform != "win32"


@cache
def _note(text: str) -> None:
    """Writes a note once."""
    log.warning(text)


class IsolatedLibrary(Library):
    """The binary of an FMU, loaded in another process.

    Raises:
        FmuError: the process cannot be started, or cannot load the FMU.
    """

    def __init__(
        self, fmu: FmuDescription, library: Path, resources: Path, limits: Limits, writable: tuple[Path, ...] = ()
    ) -> None:
        # The tool is a program outside of the FMU. pythonfmu declares one for all of its FMUs, for the interpreter.
        python = (resources / "slavemodule.txt").is_file() and not built_here(fmu)
        if fmu.capabilities.needsExecutionTool and not python:
            limits = replace(limits, restricted=False)
        self._limits, self._writable = limits, writable
        super().__init__(fmu, library, resources)
        self.isolated = True
        self.thread_safe = False  # its instances share one place for messages

    def _load(self, library: Path) -> Any:
        loading = f"loading {self.fmu.path}"
        self.child = self._started(library, loading)
        end = self.child.end()
        if end is not None or self.child.refusal:
            lines = self.child.output().splitlines()
            self.child.close()
            text = self.child.refusal or (end.text if end is not None else "")
            raise FmuError(self.fmu.model_name, loading, text, log=lines)
        if missing := self.child.unrestricted:
            _note(f"note: this kernel cannot forbid FMUs to {missing}")
        if self._limits.restarts and not all(map(self.child.has, needed := _STATES[self.fmu.fmi_version[0]])):
            lacking = next(name for name in needed if not self.child.has(name))
            self.child.close()
            text = f"its process cannot be started anew (--restart-crashed): its binary does not have {lacking}"
            raise FmuError(self.fmu.model_name, loading, text)
        make = ctypes.c_void_p(self.child.channel)
        self._made_by: dict[str, Callable[..., int | None]] = {}
        for name in ("fmi2Instantiate", "fmi3InstantiateCoSimulation", "fmi3InstantiateModelExchange"):
            function = getattr(self.child.functions, f"isolated_{name}")
            function.restype = ctypes.c_void_p
            self._made_by[name] = _Bound(function, make)
        return self.child.functions

    def _started(self, library: Path, loading: str) -> Process:
        """Returns the process, or raises FmuError for the activity `loading`."""
        try:
            if run_by_another(self.fmu):
                command = [*self.fmu.runner] or runner()
                _note(
                    f"note: {self.fmu.path.name} is run by {command[0]}: its memory, files and sockets are not limited"
                )
                self._limits = replace(self._limits, restricted=False)
                return Runner(command, portable(_WINDOWS), library, self.resources.parent, self._limits)
            if not shares_memory():
                _note("note: the memory, files and sockets of FMUs' processes are not limited on this system")
                if self.python:
                    raise CannotIsolate("a Python FMU has no process of its own on this system; try --isolate none")
                self._limits = replace(self._limits, restricted=False)
                return Runner([], portable(""), library, self.resources.parent, self._limits)
            return Child(library, self.resources.parent, self._limits, python=self.python, writable=self._writable)
        except (OSError, CannotIsolate) as error:
            text = f"its process cannot be started: {getattr(error, 'strerror', None) or error}"
            raise FmuError(self.fmu.model_name, loading, text) from None

    def _function(self, name: str) -> Any:
        if not self.has(name):
            raise FmuError(self.fmu.model_name, name, f"the binary of {self.fmu.path} does not have it")
        return self._made_by.get(name) or super()._function(name)

    def ahead(self, step: int) -> tuple[int, int] | None:
        def address(name: str) -> int:
            return ctypes.cast(getattr(self._dll, name), ctypes.c_void_p).value or 0

        for name in ("fmi2DoStep", "fmi3DoStep"):
            if step == address(name):
                return address(f"isolated_begin_{name}"), address("isolated_post")
        return None  # the step of a solver for Model Exchange

    def has(self, *functions: str) -> bool:
        return all(map(self.child.has, functions))

    def diagnosis(self, handle: int, name: str) -> Diagnosis | None:
        if handle and (failed := self.child.failed_set(handle)) is not None and self.child.end() is None:
            return Diagnosis(failed[0], "", max(failed[1], _ERROR))
        end = self.child.end()
        if end is None:
            return None
        shared = end.instance and end.instance != name
        text = f"{end.text}, in a call of {end.instance}, which shares it" if shared else end.text
        return Diagnosis(end.function, text, _FATAL, self.child.output().splitlines())

    def restarts(self) -> Sequence[str]:
        unkept = f"{self.fmu.path.name}: its state could not be kept: its process is not started anew after a crash"
        return [*map(str, self.child.restarts), *([unkept] if self.child.unkept else [])]

    def kill(self) -> None:
        self.child.kill()

    def quit(self) -> None:
        self.child.quit()

    def close(self) -> None:
        self.child.close()


class _Bound:
    """A function that instantiates in a process; `restype` can be set, as that of a function of ctypes."""

    def __init__(self, function: Any, channel: ctypes.c_void_p) -> None:
        self._function, self._channel = function, channel
        self.restype: Any = None

    def __call__(self, *arguments: Any) -> int | None:
        made: int | None = self._function(self._channel, *arguments)
        return made
