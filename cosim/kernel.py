"""The `kernel` decorator, which marks Python functions for compilation by numba.

A kernel is written in the subset of Python that numba compiles to machine code without an interpreter: plain
arithmetic, loops, branches, tuples and arrays passed as arguments. It neither allocates memory nor raises exceptions.
The same source runs in three ways: compiled just in time, compiled ahead of time into an FMU without Python, and as
plain Python (where numba is not installed, or with ``NUMBA_DISABLE_JIT=1`` for debugging). All three give the same
numbers.

Machine code is stored in one folder per digest of the sources. The digest covers the kernel's module and every module
of its package and of this package that it imports, directly or indirectly. Code is looked up first in the package
itself (``compiled/DIGEST``, which a wheel contains), then in the user's cache folder. Kernels of a single file outside
a package are compiled in every process, and so are kernels that close over others, because their module does not
determine their sources.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import time
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

__all__ = [
    "PLAIN",
    "cache_folder",
    "forget_unused",
    "get_real",
    "get_whole",
    "has_code",
    "imported_sources",
    "kernel",
    "set_real",
    "set_whole",
    "table",
]

F = TypeVar("F", bound=Callable[..., Any])

numba: Any
try:
    numba = import_module("numba")
except ImportError:  # an interpreted FMU under a Python without numba: slower, same results
    numba = None

if numba is not None and platform.machine() in ("x86_64", "AMD64") and numba.config.CPU_NAME is None:
    # The stepping loop calls FMUs that are compiled for any x86-64. When the loop itself used AVX-512, a Quadrotor's
    # step took 0.1 us longer, probably because wide and SSE code alternate on the same registers (ARCHITECTURE, section
    # 5).
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = "x86-64-v2", ""

if numba is not None:
    from cosim.lowering import Kernel

PLAIN = numba is None or bool(numba.config.DISABLE_JIT)
"""True if kernels run as plain Python: numba is not installed, or NUMBA_DISABLE_JIT=1."""

_OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True, "_nrt": False}
_UNUSED_AFTER = 14 * 24 * 3600.0


def kernel(function: F, *, inline: bool = False) -> F:
    """Marks `function` as a kernel. numba compiles it where numba is installed; otherwise it runs as plain Python.

    Division by zero follows IEEE 754 (inf, nan) instead of raising, as in a compiled FMU. The GIL is released while a
    kernel runs. Reference counting is disabled, because kernels do not allocate: for the stepping loop, whose plan is a
    tuple of many arrays, counting took longer than the FMI calls.

    Args:
        inline: compile the kernel into each caller; passing many arrays takes longer than some FMI calls.
    """
    if PLAIN:
        return function
    compiled = Kernel(function, targetoptions={**_OPTIONS, "forceinline": inline})
    source = Path(function.__code__.co_filename)
    if function.__closure__ is None and (source.parent / "__init__.py").is_file():
        compiled.keep(_code_folders(source))
    return cast(F, compiled)


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
        digest.update(file.name.encode())
        digest.update(file.read_bytes())
    name = digest.hexdigest()[:16]
    folder = cache_folder() / "kernels" / name
    if folder.is_dir():
        os.utime(folder)
    else:
        forget_unused(folder.parent)
    return _root(source) / "compiled" / name, folder


def imported_sources(module: Path) -> set[Path]:
    """Returns `module` and every file of its package and of this package that it imports, directly or indirectly.

    Parent packages are not imported for their contents, so an ``__init__.py`` counts only if a name is imported from
    it.
    """
    roots = {root.name: root.parent for root in (Path(__file__).parent, _root(module))}
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            waiting += _imported(file, tuple(roots.items()))
    return found


_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n(]+)|import[ \t]+([^\n]+))", re.MULTILINE
)


@cache
def _imported(file: Path, roots: tuple[tuple[str, Path], ...]) -> tuple[Path, ...]:
    """Returns the files below `roots` (package -> its parent folder) that `file` imports."""

    def files_of(names: Iterator[str]) -> Iterator[Path]:
        for name in names:
            first, *_ = name.split(".")
            if first in folders:
                path = folders[first].joinpath(*name.split("."))
                yield from (f for f in (path.with_suffix(".py"), path / "__init__.py") if f.is_file())

    folders = dict(roots)
    found: list[Path] = []
    for package, names, modules in _IMPORT.findall(file.read_text(encoding="utf-8")):
        if not package:
            found += files_of(name.split()[0] for name in modules.split(",") if name.strip())
            continue
        submodules = {f"{package}.{name}" for name in re.findall(r"(\w+)(?:[ \t]+as[ \t]+\w+)?", names)}
        inner = list(files_of(iter(sorted(submodules))))
        # A plain `from package import module` does not depend on the package's other exports.
        found += inner if inner and len(inner) == len(submodules) else [*inner, *files_of(iter((package,)))]
    return tuple(found)


def forget_unused(folder: Path) -> None:
    """Removes entries of `folder` that have not been used for two weeks."""
    if not folder.is_dir():
        return
    for old in folder.iterdir():
        if time.time() - old.stat().st_mtime < _UNUSED_AFTER:
            continue
        if old.is_dir():
            shutil.rmtree(old, ignore_errors=True)
        else:
            old.unlink(missing_ok=True)


# ---- access to record fields by offset -----------------------------------------------------------------------------
# A kernel names a record's fields in its source. Lookup tables of fields (parameters that a ground station names) need
# their byte offsets instead, which `cosim.model.record_layout` provides.


def _get_real(record: Any, offset: int) -> float:
    return float(record.getfield(np.float64, int(offset)))


def _set_real(record: Any, offset: int, value: float) -> None:
    record.setfield(value, np.float64, int(offset))


def _get_whole(record: Any, offset: int) -> int:
    return int(record.getfield(np.int32, int(offset)))


def _set_whole(record: Any, offset: int, value: int) -> None:
    record.setfield(value, np.int32, int(offset))


if numba is not None and not numba.config.DISABLE_JIT:
    from llvmlite import ir
    from numba.core import cgutils
    from numba.extending import intrinsic
    from numba.np import arrayobj

    def _reader(kind: Any) -> Any:
        def read(typing: Any, record: Any, offset: Any) -> Any:  # noqa: ARG001 (numba prescribes the arguments)
            def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
                address = builder.bitcast(arguments[0], cgutils.voidptr_t)
                place = builder.gep(address, [arguments[1]])
                return builder.load(builder.bitcast(place, context.get_value_type(kind).as_pointer()))

            return kind(record, numba.types.int64), lower

        return intrinsic(read)

    def _writer(kind: Any) -> Any:
        def write(typing: Any, record: Any, offset: Any, value: Any) -> Any:  # noqa: ARG001
            def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
                address = builder.bitcast(arguments[0], cgutils.voidptr_t)
                place = builder.gep(address, [arguments[1]])
                builder.store(arguments[2], builder.bitcast(place, context.get_value_type(kind).as_pointer()))
                return context.get_dummy_value()

            return numba.types.void(record, numba.types.int64, kind), lower

        return intrinsic(write)

    class _OnStack:
        """Context that allocates the memory for a copy on the stack and releases it."""

        def __init__(self, context: Any, builder: Any) -> None:
            self._context, self.nrt = context, self
            self._before = cgutils.alloca_once(builder, cgutils.voidptr_t)

        def __getattr__(self, name: str) -> Any:
            return getattr(self._context, name)

        def allocate(self, builder: Any, size: Any) -> Any:
            save = builder.module.declare_intrinsic("llvm.stacksave.p0", (), ir.FunctionType(cgutils.voidptr_t, ()))
            builder.store(builder.call(save, ()), self._before)
            return builder.alloca(ir.IntType(8), size)

        def free(self, builder: Any, _: Any) -> None:
            kind = ir.FunctionType(ir.VoidType(), (cgutils.voidptr_t,))
            restore = builder.module.declare_intrinsic("llvm.stackrestore.p0", (), kind)
            builder.call(restore, (builder.load(self._before),))

    _maybe_copy_source = arrayobj.maybe_copy_source

    def _copy_source(context: Any, builder: Any, *arguments: Any) -> Any:
        """Compiles ``m.v[1:] = m.v[:2]``: overlapping slices are copied through the stack, since kernels do not
        allocate.
        """
        within = context if context.enable_nrt else _OnStack(context, builder)
        return _maybe_copy_source(within, builder, *arguments)

    arrayobj.maybe_copy_source = _copy_source

    _get_real, _set_real = _reader(numba.types.float64), _writer(numba.types.float64)
    _get_whole, _set_whole = _reader(numba.types.int32), _writer(numba.types.int32)


@kernel
def get_real(record: Any, offset: int) -> float:
    """Returns the float64 at byte `offset` of a record; the offset is not checked."""
    return _get_real(record, offset)


@kernel
def set_real(record: Any, offset: int, value: float) -> None:
    """Writes the float64 at byte `offset` of a record; the offset is not checked."""
    _set_real(record, offset, value)


@kernel
def get_whole(record: Any, offset: int) -> int:
    """Returns the int32 at byte `offset` of a record; the offset is not checked."""
    return _get_whole(record, offset)


@kernel
def set_whole(record: Any, offset: int, value: int) -> None:
    """Writes the int32 at byte `offset` of a record; the offset is not checked."""
    _set_whole(record, offset, value)
