"""The interpreted build: pythonfmu packs the sources with its wrapper binary, for editing and debugging without
compiler.

Kernels run as plain Python on a numpy record, which checks every index; numba is not used. All Python FMUs of a process
share one interpreter, so the entry module has a unique name and loads the model's modules from its own FMU only. Two
FMUs with different versions of a module can therefore run side by side.
"""

from __future__ import annotations

import inspect
import json
import os
import shutil
import sys
import tempfile
import threading
import zipfile
from collections.abc import Mapping
from pathlib import Path

from pythonfmu import FmuBuilder

from cosim.build.description import as_text, model_description
from cosim.build.sources import Sources
from cosim.model import Model

__all__ = ["build_interpreted"]

_ENTRY = '''"""Entry module of one interpreted FMU, written by `uav-cosim build`."""

import hashlib
import importlib.util
import pathlib
import sys
from xml.etree.ElementTree import fromstring

DIGESTS = {digests!r}
HERE = pathlib.Path(__file__).parent


def _load():
    """Loads the model's module from this FMU's own sources, its kernels as plain Python."""
    hidden = set(DIGESTS) | ({{"numba"}} if {plain} else set())
    before = {{name: sys.modules.pop(name) for name in hidden if name in sys.modules}}
    if {plain}:
        sys.modules["numba"] = None  # cosim.kernel leaves functions unchanged without numba
    sys.path.insert(0, str(HERE))
    try:
        importlib.invalidate_caches()
        found = importlib.import_module({module!r})
        for name in DIGESTS:
            file = pathlib.Path(importlib.util.find_spec(name).origin)
            if hashlib.sha256(file.read_bytes()).hexdigest() != DIGESTS[name]:
                raise ImportError(f"the FMU {model} is damaged: {{file}} is not the file that it was built from")
        return found
    finally:
        sys.path.remove(str(HERE))
        for name in hidden:
            sys.modules.pop(name, None)
        sys.modules.update(before)


_Model = _load().{model}


class {model}(_Model):
    __doc__ = _Model.__doc__

    @staticmethod
    def entry():
        return fromstring((HERE / "description.xml").read_text(encoding="utf-8"))
'''


def build_interpreted(model: type[Model], sources: Sources, stamp: Mapping[str, object], file: Path) -> None:
    """Writes the FMU `file`.

    Raises:
        RuntimeError: pythonfmu put no binary into the file.
    """
    guid = sources.guid(model.__name__)
    entry = f"cosim_fmu_{model.__name__.lower()}_{guid[:8]}"
    with tempfile.TemporaryDirectory(prefix="uav-cosim-build-") as temporary:
        folder = Path(temporary)
        project_files = _copy_sources(sources, folder)
        named = {"digests": dict(sources.digests), "module": model.__module__, "model": model.__name__}
        script = folder / f"{entry}.py"
        script.write_text(_ENTRY.format(**named, plain=model.kernels is not None))
        description = folder / "description.xml"
        description.write_text(as_text(model_description(model, guid, compiled=False)), encoding="utf-8")
        build = folder / "build.json"
        build.write_text(json.dumps(dict(stamp), indent=1, sort_keys=True))
        path, loaded = list(sys.path), set(sys.modules)
        try:
            written = FmuBuilder.build_FMU(
                script, dest=folder / "out", project_files=[*project_files, description, build]
            )
        finally:
            sys.path[:] = path
            for name in set(sys.modules) - loaded:
                if name == entry:
                    del sys.modules[name]
        _refuse_without_binary(model.__name__, Path(written))
        _normalise(Path(written), file)


def _refuse_without_binary(model: str, built: Path) -> None:
    with zipfile.ZipFile(built) as archive:
        if any(name.startswith("binaries/") for name in archive.namelist()):
            return
    found = Path(inspect.getfile(FmuBuilder)).parent
    text = f"{model}: the pythonfmu in {found} has no binaries: an FMU that this process has loaded brought it along; "
    raise RuntimeError(f"{text}import cosim.build before that, or build in another process")


def _copy_sources(sources: Sources, folder: Path) -> list[Path]:
    """Copies the closure below `folder`; returns its top-level packages and modules."""
    top: set[Path] = set()
    for name, file in sources.files.items():
        parts = name.split(".")
        target = folder.joinpath(*parts)
        target = target / "__init__.py" if name in sources.packages else target.with_suffix(".py")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        top.add(folder / parts[0] if len(parts) > 1 or name in sources.packages else target)
    return sorted(top)


def _normalise(built: Path, file: Path) -> None:
    """Copies the archive with sorted entries and fixed timestamps, so that the same sources give the same bytes."""
    temporary = file.with_suffix(f".{os.getpid()}.{threading.get_ident()}.part")
    with zipfile.ZipFile(built) as source, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as target:
        for name in sorted(source.namelist()):
            target.writestr(zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0)), source.read(name), zipfile.ZIP_DEFLATED)
    temporary.replace(file)
