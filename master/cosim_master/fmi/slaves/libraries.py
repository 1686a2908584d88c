"""Loading of FMU files; each file is unpacked and loaded once, whatever the number of its instances.

Python FMUs of one process share one interpreter and its modules. Before any FMU is loaded, their sources are therefore
compared with each other and with the modules of this process.
"""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Self, TypeVar

from cosim.kernel import cache_folder
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import PYTHON_SOURCES
from cosim_master.fmi.description.read import SOURCES, FmuDescription, extract
from cosim_master.fmi.slaves.fmi1 import Library1
from cosim_master.fmi.slaves.fmi2 import Library, SharedHandle
from cosim_master.fmi.slaves.sources_only import compiled
from cosim_master.fmi.slaves.table import TableLibrary

__all__ = ["Libraries", "check_sources"]

log = logging.getLogger(__name__)

_Made = TypeVar("_Made")


def _sources(fmu: FmuDescription) -> dict[str, str]:
    """Returns module name -> digest of the modules that a Python FMU contains; empty for all other FMUs.

    Our FMUs name the files they were built from; of other pythonfmu FMUs every source file among the resources counts.
    """
    if fmu.table is not None:
        return {}
    with zipfile.ZipFile(fmu.path) as archive:
        names = set(archive.namelist())
        if "resources/slavemodule.txt" not in names:
            return {}
        if "resources/build.json" in names:
            sources = json.loads(archive.read("resources/build.json"))["sources"]
            return {str(name): str(digest) for name, digest in sources.items()}
        files = {name: PurePosixPath(name).relative_to("resources") for name in names if _is_source(name)}
        return {
            ".".join(p.parent.parts if p.name == "__init__.py" else p.with_suffix("").parts): hashlib.sha256(
                archive.read(name)
            ).hexdigest()
            for name, p in files.items()
        }


def _is_source(member: str) -> bool:
    return member.startswith("resources/") and member.endswith(".py")


def check_sources(fmus: Iterable[FmuDescription]) -> None:
    """Refuses Python FMUs that would run each other's code, or this process's instead of their own.

    Raises:
        SystemDescriptionError: two versions of a module differ; the error names the FMUs and the module.
    """
    first: dict[str, tuple[str, FmuDescription]] = {}
    problems: list[Problem] = []
    for fmu in fmus:
        for name, digest in sorted(_sources(fmu).items()):
            loaded = getattr(sys.modules.get(name), "__file__", None)
            other, whose = first.setdefault(name, (digest, fmu))
            remedy = "build the FMUs anew (make fmus), or give one of the modules another name"
            if loaded and _digest(Path(loaded)) != digest:
                text = f"was built from another {name} than the one loaded here ({loaded}); {remedy}"
                problems.append(Problem(Where(str(fmu.path)), text))
                break
            if other != digest:
                text = PYTHON_SOURCES.text(name, whose.path, remedy)
                problems.append(Problem(Where(str(fmu.path)), text))
                break
    if problems:
        raise SystemDescriptionError(problems)


def _digest(file: Path) -> str:
    """Returns the digest of a file's contents; empty if the file does not exist."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""


def _opened(fmu: FmuDescription, folder: Path) -> Library:
    """Returns the library of an FMU that is unpacked in a folder."""
    kind = Library1 if fmu.fmi_version == "1.0" else Library
    if fmu.library == SOURCES:
        return kind(fmu, compiled(fmu, folder), folder / "resources")
    return kind(fmu, folder.joinpath(*fmu.library.split("/")), folder / "resources")


class Libraries:
    """The loaded FMU files. This context manager removes unpacked files at its end, after all instances are freed."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="uav-cosim-"))
        self._loaded: dict[tuple[Path, str], Library] = {}
        self._sharing: set[Path] = set()
        self._copies = 0

    def load(self, fmu: FmuDescription) -> Library:
        """Returns the library of an FMU file, and loads it if necessary."""
        key = (fmu.path, fmu.library)
        library = self._loaded.get(key)
        if library is None:
            if fmu.table is not None:
                library = TableLibrary(fmu, self._folder)
            else:
                library = _opened(fmu, self._unpacked(fmu))
            self._loaded[key] = library
        return library

    def instantiate(self, fmu: FmuDescription, name: str, make: Callable[[Library, str], _Made]) -> _Made:
        """Returns a new instance of an FMU, which `make` creates from its library.

        An FMU that stores its state in globals is loaded again for each further instance, from a separate copy of the
        library: the dynamic linker then gives each copy its own globals.

        Raises:
            FmuError: the FMU refused.
        """
        library = self.load(fmu)
        if fmu.path not in self._sharing:
            try:
                return make(library, name)
            except SharedHandle:
                self._sharing.add(fmu.path)
                log.warning(
                    "note: %s keeps everything in globals: each of its instances gets a copy of it", fmu.path.name
                )
        self._copies += 1
        folder = self._folder / f"copy{self._copies}"
        extract(fmu, folder)
        return make(_opened(fmu, folder), name)

    def _unpacked(self, fmu: FmuDescription) -> Path:
        if not _sources(fmu):
            folder = self._folder / str(len(self._loaded))
            extract(fmu, folder)
            return folder
        # Python FMUs remain in their folder, so that Python and numba find their compiled code, and `check_sources` the
        # files.
        folder = cache_folder() / "fmus" / fmu.digest[:24]
        if not folder.is_dir():
            fresh = Path(tempfile.mkdtemp(prefix="new-", dir=self._made(folder.parent)))
            extract(fmu, fresh / "fmu")
            try:
                (fresh / "fmu").rename(folder)
            except OSError:
                if not folder.is_dir():
                    raise
            shutil.rmtree(fresh, ignore_errors=True)
        return folder

    @staticmethod
    def _made(folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
