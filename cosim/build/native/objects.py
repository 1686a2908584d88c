"""Cache of models' object code in the user's cache folder, keyed by a digest of all inputs.

FMI 2 and FMI 3 builds, tests and several checkouts share it: the same kernels, sources, record, tools and target give
the same object. So do models that differ in start values only, such as the multirotors. Only models of packages are
cached, because the local imports of a single file are not tracked.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np

from cosim.build.sources import Sources, sources_of_module
from cosim.kept import made_once, read_kept, write_kept
from cosim.kernel import cache_folder, forget_unused, imported_sources
from cosim.model import Model

__all__ = ["object_code"]


def object_code(
    model: type[Model], sources: Sources, dtype: np.dtype[np.void], how: str, make: Callable[[], bytes]
) -> bytes:
    """Returns the object code of `model`, from the cache or created by `make` and then cached.

    Args:
        how: further inputs of the code: its target and build options.
    """
    if "." not in model.__module__:
        return make()
    file = cache_folder() / "objects" / f"{_digest(model, sources, dtype, how)}.o"
    if (code := read_kept(file)) is not None:
        os.utime(file)
        return code
    with made_once(file):
        code = read_kept(file)
        if code is None:
            code = make()
            forget_unused(file.parent)
            write_kept(file, code)
    return code


def _digest(model: type[Model], sources: Sources, dtype: np.dtype[np.void], how: str) -> str:
    digest = hashlib.sha256(f"{dtype.descr} {how} ".encode())
    digest.update(f"{sys.version_info[:2]} {sys.platform} {platform.machine()}".encode())
    for tool in ("numba", "llvmlite", "numpy"):
        digest.update(f"{tool} {version(tool)} ".encode())
    for text in _origin(model, sources):
        digest.update(text)
    for file in sorted(imported_sources(Path(__file__).with_name("compiled.py"))):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _origin(model: type[Model], sources: Sources) -> Iterator[bytes]:
    """Yields texts that determine the kernels of a model: their names, and the sources of their modules.

    A kernel that closes over others, such as an agent's over its law, is determined by the sources of the model.
    """
    functions = [getattr(kernel, "py_func", kernel) for kernel in model.kernels or ()]
    if not functions or any(function.__closure__ for function in functions):
        yield f"{model.__module__}.{model.__qualname__} {sorted(sources.digests.items())}".encode()
        return
    for function in functions:
        of_module = sources_of_module(function.__module__)
        yield f"{function.__module__}.{function.__qualname__} {sorted(of_module.digests.items())}".encode()
