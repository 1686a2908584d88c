"""The `kernel` decorator, which marks Python functions for compilation by numba.

A kernel is written in the subset of Python that numba compiles to machine code without an interpreter: plain
arithmetic, loops, branches, tuples and arrays passed as arguments. It neither allocates memory nor raises exceptions.
The same source runs in three ways: compiled just in time, compiled ahead of time into an FMU without Python, and as
plain Python (where numba is not installed, or with ``NUMBA_DISABLE_JIT=1`` for debugging). All three give the same
numbers.

Machine code is stored in one folder per digest of the sources, each file with a digest of its own contents, which is
checked before the code is loaded. The digest of the sources covers the kernel's module and every module that it
imports, directly or indirectly, of its package, of this one, and of others that use this one. Code is looked up first
in the package itself (``compiled/DIGEST``, which a wheel contains), then in the user's cache folder. Kernels of a
single file outside a package are compiled in every process, and so are kernels that close over others, because their
module does not determine their sources.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial, update_wrapper
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from cosim.deferred import Deferred

__all__ = [
    "PLAIN",
    "Kernel",
    "cache_folder",
    "compiler",
    "forget_unused",
    "has_code",
    "imported_sources",
    "kernel",
    "processor",
    "table",
    "used_code",
]

F = TypeVar("F", bound=Callable[..., Any])

PLAIN = find_spec("numba") is None or os.environ.get("NUMBA_DISABLE_JIT", "").strip() not in ("", "0")
"""True if kernels run as plain Python: numba is not installed, or NUMBA_DISABLE_JIT=1.

An interpreted FMU may run under a Python without numba: slower, with the same results.
"""

_OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True, "_nrt": False}
used_code: dict[Path, None] = {}
"""The files of machine code that this process has loaded or written."""

_UNUSED_AFTER = 14 * 24 * 3600.0


def kernel(function: F, *, inline: bool = False) -> F:
    """Marks `function` as a kernel. numba compiles it where numba is installed; otherwise it runs as plain Python.

    Division by zero follows IEEE 754 (inf, nan) instead of raising, as in a compiled FMU. The GIL is released while a
    kernel runs. Reference counting is disabled, because kernels do not allocate: for the stepping loop, whose plan is a
    tuple of many arrays, counting took longer than the FMI calls.

    Args:
        inline: compile the kernel into each caller; passing many arrays takes longer than some FMI calls.
    """
    return function if PLAIN else cast(F, Kernel(function, inline=inline))


class Kernel(Deferred):
    """A function that numba compiles when it is first called or when a caller is compiled, and imports until then not.

    It has all attributes of numba's dispatcher (`cosim.lowering.Kernel`).
    """

    def __init__(self, function: Callable[..., Any], *, inline: bool = False) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._inline = inline

    @cached_property
    def folders(self) -> Callable[[], tuple[Path, Path]] | None:
        """Returns the folders of machine code, the package's own and the user's; None: it is not stored."""
        source = Path(self.py_func.__code__.co_filename)
        # A file of a package that was not loaded as its module imports others beside it by names without the package.
        of_package = _in_package(source.parent) and self.py_func.__module__ != source.stem
        return partial(_code_folders, source) if self.py_func.__closure__ is None and of_package else None

    @cached_property
    def compiled(self) -> Any:
        compiler()
        from cosim.lowering import Kernel as Dispatcher

        made = Dispatcher(self.py_func, targetoptions={**_OPTIONS, "forceinline": self._inline})
        if self.folders is not None:
            made.keep(self.folders)
        return made

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self.compiled(*arguments, **named)

    def __repr__(self) -> str:
        return f"Kernel({self.py_func!r})"

    def __getattr__(self, name: str) -> Any:
        if name == "compiled" or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.compiled, name)


@cache
def _in_package(folder: Path) -> bool:
    return (folder / "__init__.py").is_file()


def processor() -> tuple[str, str] | None:
    """Returns the processor and the features for which kernels are compiled, in LLVM's names; None: this one.

    The stepping loop calls FMUs that are compiled for any x86-64. When the loop itself used AVX-512, a Quadrotor's step
    took 0.1 us longer, probably because wide and SSE code alternate on the same registers (ARCHITECTURE, section 5).
    """
    given = os.environ.get("NUMBA_CPU_NAME")
    if given is not None or platform.machine() not in ("x86_64", "AMD64"):
        return None
    return "x86-64-v2", ""


@cache
def compiler() -> Any:
    """Returns numba, prepared to compile kernels; it takes longer to import than all that a short run does."""
    numba: Any = import_module("numba")
    if (chosen := processor()) is not None:
        numba.config.CPU_NAME, numba.config.CPU_FEATURES = chosen
    import_module("cosim.lowering")
    return numba


def table(rows: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Returns a structured array in the form whose fields kernels access by name, also as plain Python."""
    return rows.view(np.recarray) if PLAIN else rows


def cache_folder() -> Path:
    """Returns the folder for files that can be regenerated: $XDG_CACHE_HOME/uav-cosim or ~/.cache/uav-cosim."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uav-cosim"


def _root(source: Path) -> Path:
    """Returns the outermost package that contains `source`."""
    root = source.parent
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    return root


def has_code(source: Path, name: str) -> bool:
    """Returns whether machine code of the kernel `name` of `source` is stored, possibly for another processor."""
    return any(any(folder.glob(f"{name}-*.kernel")) for folder in _code_folders(source))


@cache
def _code_folders(source: Path) -> tuple[Path, Path]:
    """Returns the folders that are searched for machine code of the kernels of `source`, by digest of their sources.

    The package's own folder (``compiled/DIGEST``) comes first, then the user's cache, which receives new code.
    """
    digest = hashlib.sha256()
    for file in sorted({Path(__file__), *imported_sources(source)}):
        digest.update(file.relative_to(_root(file).parent).as_posix().encode())  # code names the modules of its kernels
        digest.update(file.read_bytes())
    name = digest.hexdigest()[:16]
    folder = cache_folder() / "kernels" / name
    if folder.is_dir():
        os.utime(folder)
    else:
        forget_unused(folder.parent)
    return _root(source) / "compiled" / name, folder


def imported_sources(module: Path) -> set[Path]:
    """Returns `module` and every file that it imports, directly or indirectly.

    These are files of its package, of this package, and of packages with modules that import this one, such as
    cosim_models. Parent packages are not imported for their contents, so an ``__init__.py`` counts only if a name is
    imported from it.
    """
    roots = {root.name: root.parent for root in (Path(__file__).parent, _root(module))}
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            roots |= _made_for_cosim(file, frozenset(roots))
            waiting += _imported(file, tuple(roots.items()))
    return found


_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n(]+)|import[ \t]+([^\n]+))", re.MULTILINE
)


_USES_COSIM = re.compile(rb"^(?:from|import) cosim\b", re.MULTILINE)
"""In bytes: the sources of others may have any encoding."""


@cache
def _imports(file: Path) -> tuple[tuple[str, str, str], ...]:
    """Returns the imports of a file as texts: package and names of ``from package import names``, or modules."""
    return tuple(_IMPORT.findall(file.read_text(encoding="utf-8")))


@cache
def _uses_cosim(file: str) -> bool:
    return os.path.isfile(file) and _USES_COSIM.search(Path(file).read_bytes()) is not None  # noqa: PTH113 (a third of the time)


@cache
def _made_for_cosim(file: Path, known: frozenset[str]) -> dict[str, Path]:
    """Returns the packages of modules that `file` imports and that import this package -> their parent folders."""
    found: dict[str, Path] = {}
    for package, names, _ in _imports(file):
        first = package.partition(".")[0]
        if not first or first in known or first in found or first in sys.stdlib_module_names:
            continue
        if (root := _package(first)) is None:
            continue
        modules = (package, *(f"{package}.{name}" for name in re.findall(r"\w+", names)))
        paths = ("/".join((str(root), *module.split(".")[1:])) for module in modules if "." in module)
        if any(_uses_cosim(f"{path}.py") or _uses_cosim(f"{path}/__init__.py") for path in paths):
            found[first] = root.parent
    return found


@cache
def _package(name: str) -> Path | None:
    """Returns the folder of a package; None if there is none of this name, or if it is a single module."""
    try:
        spec = find_spec(name)
    except ValueError:  # a module that was not imported from anywhere, such as __main__
        return None
    folders = spec.submodule_search_locations if spec is not None and spec.origin else None
    return Path(next(iter(folders))) if folders else None


@cache
def _imported(file: Path, roots: tuple[tuple[str, Path], ...]) -> tuple[Path, ...]:
    """Returns the files below `roots` (package -> its parent folder) that `file` imports."""

    def files_of(names: Iterator[str]) -> Iterator[Path]:
        for name in names:
            if (folder := folders.get(name.partition(".")[0])) is not None:
                yield from _files_of(folder, name)

    folders = dict(roots)
    found: list[Path] = []
    for package, names, modules in _imports(file):
        if not package:
            found += files_of(name.split()[0] for name in modules.split(",") if name.strip())
            continue
        submodules = {f"{package}.{name}" for name in re.findall(r"(\w+)(?:[ \t]+as[ \t]+\w+)?", names)}
        inner = list(files_of(iter(sorted(submodules))))
        # A plain `from package import module` does not depend on the package's other exports.
        found += inner if inner and len(inner) == len(submodules) else [*inner, *files_of(iter((package,)))]
    return tuple(found)


@cache
def _files_of(folder: Path, name: str) -> tuple[Path, ...]:
    """Returns the file of a module or package below a folder, if there is one."""
    path = "/".join((str(folder), *name.split(".")))
    return tuple(Path(file) for file in (f"{path}.py", f"{path}/__init__.py") if os.path.isfile(file))  # noqa: PTH113


def forget_unused(folder: Path) -> None:
    """Removes entries of `folder` that have not been used for two weeks; other processes may add and remove entries."""
    if not folder.is_dir():
        return
    for old in folder.iterdir():
        try:
            used = old.stat().st_mtime
        except FileNotFoundError:  # a lock or a part that another process has just removed
            continue
        if time.time() - used < _UNUSED_AFTER:
            continue
        if old.is_dir():
            shutil.rmtree(old, ignore_errors=True)
        else:
            old.unlink(missing_ok=True)
