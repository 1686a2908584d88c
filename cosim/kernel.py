"""The decorator of everything that is stepped: Python that numba compiles.

A kernel is written in the subset of Python that numba lowers to machine code without an interpreter: plain
arithmetic, loops, branches, tuples, arrays that are passed in; no allocation and no exceptions. The same source
runs in three ways: compiled just in time, compiled ahead of time into an FMU without Python, and as plain Python
(where numba is not installed, or with ``NUMBA_DISABLE_JIT=1`` to debug). All three give the same numbers.

Compiled kernels of a package are kept in the user's cache folder, in one folder per state of its sources (and of
this package's): numba itself looks only at the file of the function it loads, and would go on calling the old code
of a callee in another file. Kernels of a single file outside a package are compiled anew each time.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, cast

__all__ = ["cache_folder", "kernel"]

F = TypeVar("F", bound=Callable[..., Any])

numba: Any
try:
    numba = import_module("numba")
except ImportError:  # an interpreted FMU in somebody's Python without numba: slower, same results
    numba = None

_UNUSED_AFTER = 14 * 24 * 3600.0


def kernel(function: F) -> F:
    """Mark `function` as a kernel: compiled by numba where it can be imported, as it is otherwise.

    Division by zero follows IEEE 754 (inf, nan) instead of raising, as it does in a compiled FMU. The GIL is
    released while a kernel runs. A kernel allocates nothing, so numba counts no references: for the stepping loop,
    whose plan is a tuple of many arrays, counting took longer than the calls of FMI functions.
    """
    if numba is None:
        return function
    compiled = numba.njit(error_model="numpy", nogil=True, _nrt=False)(function)
    source = Path(function.__code__.co_filename)
    if not numba.config.DISABLE_JIT and (source.parent / "__init__.py").is_file():
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(_compiled_folder(_root(source)))
        try:
            compiled.enable_caching()
        finally:
            numba.config.CACHE_DIR = before
    return cast(F, compiled)


def cache_folder() -> Path:
    """Where this project keeps what it can make again: $XDG_CACHE_HOME/uav-cosim or ~/.cache/uav-cosim."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uav-cosim"


def _root(source: Path) -> Path:
    """The outermost package that holds `source`."""
    root = source.parent
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    return root


@cache
def _compiled_folder(root: Path) -> Path:
    digest = hashlib.sha256()
    for part in (Path(__file__).parent, root):
        for file in sorted(part.rglob("*.py")):
            digest.update(str(file.relative_to(part.parent)).encode())
            digest.update(file.read_bytes())
    folder = cache_folder() / "kernels" / digest.hexdigest()[:16]
    if not folder.is_dir():
        _forget_unused(folder.parent)
        folder.mkdir(parents=True, exist_ok=True)
    else:
        os.utime(folder)
    return folder


def _forget_unused(kernels: Path) -> None:
    """Remove compiled kernels of sources that nobody has loaded for two weeks."""
    if not kernels.is_dir():
        return
    for old in kernels.iterdir():
        if time.time() - old.stat().st_mtime > _UNUSED_AFTER:
            shutil.rmtree(old, ignore_errors=True)
