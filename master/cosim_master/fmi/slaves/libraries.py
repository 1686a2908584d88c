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
from contextlib import suppress
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Self, TypeVar

from cosim.kernel import cache_folder
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import PYTHON_SOURCES
from cosim_master.files import temporary
from cosim_master.files.kept import intact_copy, private_cache
from cosim_master.fmi.description.read import SOURCES, FmuDescription, extract
from cosim_master.fmi.isolation.remote import Address
from cosim_master.fmi.slaves.fmi1 import Library1
from cosim_master.fmi.slaves.fmi2 import Library, SharedHandle
from cosim_master.fmi.slaves.hosted import HostedLibrary
from cosim_master.fmi.slaves.isolated import IsolatedLibrary, Isolation, built_here
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


class Libraries:
    """The loaded FMU files. This context manager removes unpacked files at its end, after all instances are freed.

    Args:
        isolation: selects the FMUs that run in processes of their own; None: all run in this process.
        opened: called with each library that is loaded.
    """

    def __init__(self, isolation: Isolation | None = None, opened: Callable[[Library], None] | None = None) -> None:
        self._isolation = isolation or Isolation("none")
        self._on_opened = opened or (lambda _: None)
        self._folder = temporary.made()
        self._unpacked_in: dict[tuple[Path, str], Path] = {}
        self._loaded: dict[tuple[Path, str, tuple[str, ...], bool], Library] = {}
        self._opened: list[Library] = []
        self._sharing: set[Path] = set()
        self._there: dict[tuple[Path, Address], Library] = {}
        self._alone: set[tuple[Path, Address]] = set()
        self._copies = 0

    def load(self, fmu: FmuDescription) -> Library:
        """Returns the library of an FMU file, and loads it if necessary."""
        return self._load(fmu, "", isolated=self._isolation.isolates(fmu))

    def _load(self, fmu: FmuDescription, name: str, *, isolated: bool) -> Library:
        key = (fmu.path, fmu.library, fmu.runner, isolated)
        library = self._loaded.get(key)
        if library is None:
            if fmu.table is not None:
                library = TableLibrary(fmu, self._folder)
            else:
                library = self._open(fmu, self._folder_of(fmu), name, isolated=isolated)
            self._loaded[key] = library
        return library

    def _open(self, fmu: FmuDescription, folder: Path, name: str, *, isolated: bool) -> Library:
        """Returns the library of an FMU that is unpacked in a folder, in this process or that of an instance."""
        binary = compiled(fmu, folder) if fmu.library == SOURCES else folder.joinpath(*fmu.library.split("/"))
        resources = folder / "resources"
        library: Library
        if isolated:
            # Ours keep compiled kernels in the user's cache.
            writable = (cache_folder(),) if built_here(fmu) else ()
            library = IsolatedLibrary(fmu, binary, resources, self._isolation.limits_of(name), writable)
        elif fmu.fmi_version == "1.0":
            library = Library1(fmu, binary, resources)
        else:
            library = Library(fmu, binary, resources)
        self._opened.append(library)
        self._on_opened(library)
        return library

    def _folder_of(self, fmu: FmuDescription) -> Path:
        key = (fmu.path, fmu.library)
        if key not in self._unpacked_in:
            self._unpacked_in[key] = self._unpacked(fmu)
        return self._unpacked_in[key]

    def instantiate(self, fmu: FmuDescription, name: str, make: Callable[[Library, str], _Made]) -> _Made:
        """Returns a new instance of an FMU, which `make` creates from its library.

        An FMU that stores its state in globals is loaded again for each further instance: in a process of its own, or
        from a separate copy of the library, since the dynamic linker then gives each copy its own globals.

        Raises:
            FmuError: the FMU refused.
        """
        isolated = self._isolation.isolates(fmu, name)
        if name in self._isolation.hosts:
            return self._hosted(fmu, name, make)
        if isolated and self._isolation.each(fmu, name):
            return make(self._open(fmu, self._folder_of(fmu), name, isolated=True), name)
        library = self._load(fmu, name, isolated=isolated)
        if fmu.path not in self._sharing:
            try:
                return make(library, name)
            except SharedHandle:
                self._sharing.add(fmu.path)
                own = "process" if isolated else "copy of it"
                log.warning("note: %s keeps everything in globals: each of its instances gets a %s", fmu.path.name, own)
        if isolated:
            return make(self._open(fmu, self._folder_of(fmu), name, isolated=True), name)
        self._copies += 1
        folder = self._folder / f"copy{self._copies}"
        extract(fmu, folder)
        return make(self._open(fmu, folder, name, isolated=False), name)

    def _hosted(self, fmu: FmuDescription, name: str, make: Callable[[Library, str], _Made]) -> _Made:
        """Returns a new instance on another machine: in the process of its file there, or in one of its own."""
        address = self._isolation.hosts[name]
        if not self._isolation.each(fmu, name) and (fmu.path, address) not in self._alone:
            library = self._there.get((fmu.path, address)) or self._connected(fmu, name)
            self._there[fmu.path, address] = library
            try:
                return make(library, name)
            except SharedHandle:
                self._alone.add((fmu.path, address))
        return make(self._connected(fmu, name), name)

    def _connected(self, fmu: FmuDescription, name: str) -> Library:
        """Returns the library of an FMU in a new process on the machine of an instance."""
        isolation = self._isolation
        library = HostedLibrary(fmu, isolation.hosts[name], isolation.token, isolation.limits_of(name))
        self._opened.append(library)
        self._on_opened(library)
        return library

    def _unpacked(self, fmu: FmuDescription) -> Path:
        if not _sources(fmu):
            folder = self._folder / str(len(self._unpacked_in))
            extract(fmu, folder)
            return folder
        # Python FMUs remain in their folder, so that Python and numba find their compiled code, and `check_sources` the
        # files.
        folder = private_cache() / "fmus" / fmu.digest[:24]
        if not intact_copy(fmu.path, folder):
            fresh = Path(tempfile.mkdtemp(prefix="new-", dir=self._made(folder.parent)))
            extract(fmu, fresh / "fmu")
            with suppress(FileNotFoundError):
                folder.rename(fresh / "damaged")
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
        for library in self._opened:
            library.quit()
        for library in self._opened:
            library.close()
        self._opened.clear()
        temporary.remove(self._folder)
