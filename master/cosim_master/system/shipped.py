"""The systems that are part of this project, by name: ``line5`` is the folder of that name.

In a source tree, they are in master/systems; their FMUs are in fmus/, where `make fmus` writes them. An installed
package has a copy of both folders next to this module (`setup.py` puts them into the wheel). If a wheel has no FMUs, or
if its Python sources have been changed since, a copy is made in the user's cache folder for each state of the sources,
and its FMUs are built there once.

`python -m cosim_master.system.shipped FOLDER` builds the other files of a wheel; `make wheel` calls it.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from cosim.kernel import cache_folder

__all__ = ["digest_of_models", "document", "find", "fmu", "fmus", "names", "stage", "templates"]

_PACKAGE = Path(__file__).parents[1]
_INSTALLED = _PACKAGE / "shipped"
_MODELS = "cosim_models"
_log = logging.getLogger(__name__)


def names() -> tuple[str, ...]:
    """Returns the names of the systems, sorted."""
    systems = _root() / "master" / "systems"
    return tuple(sorted(path.parent.name for path in systems.glob("*/SystemStructure.ssd")))


def find(name: str) -> Path | None:
    """Returns the folder of the system `name`, with its FMUs; None if no system of this name is shipped.

    In a source tree, `make fmus` must have built the FMUs.

    Raises:
        RuntimeError: FMUs must be built and the C compiler failed.
        ValueError, ImportError: as for `cosim.build.build_all`.
    """
    return _ready() / "master" / "systems" / name if name in names() else None


def document(system: str, name: str) -> Path:
    """Returns the document `name` of a shipped system, whose FMUs need not exist."""
    return _root() / "master" / "systems" / system / name


def fmus() -> Path:
    """Returns the folder with the FMUs of the shipped systems.

    Raises:
        RuntimeError, ValueError, ImportError: as `find`.
    """
    return _ready() / "fmus"


def fmu(model: str) -> Path | None:
    """Returns the FMU of the model with this name, or None if it does not exist or has not been built.

    Raises:
        RuntimeError, ValueError, ImportError: as `find`.
    """
    file = fmus() / f"{model}.fmu"
    return file if model.isidentifier() and file.is_file() else None


def templates() -> dict[str, Path]:
    """Returns the starting points for new models, which are files with the text of a model, by kind."""
    folder = Path(str(import_module(_MODELS).__file__)).parent / "templates"
    return {file.stem: file for file in sorted(folder.glob("*.txt"))}


def _ready() -> Path:
    """Returns the folder that contains master/systems and, unless it is a source tree without them, fmus."""
    root = _root()
    return _built() if root == _INSTALLED and not _has_own_fmus() else root


def digest_of_models() -> str:
    """Returns the digest of all sources that FMUs are built from."""
    digest = hashlib.sha256()
    for package in ("cosim", _MODELS):
        folder = Path(str(import_module(package).__file__)).parent
        for file in sorted(folder.rglob("*")):
            if file.suffix in (".py", ".c", ".h") and file.is_file():
                digest.update(f"{package}/{file.relative_to(folder).as_posix()}\n".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _root() -> Path:
    return _INSTALLED if _INSTALLED.is_dir() else _PACKAGE.parents[1]


def _has_own_fmus() -> bool:
    """Returns whether the installed FMUs are for this platform and built from the installed sources."""
    from cosim.build import HOST

    stamp = _INSTALLED / "fmus" / "built-from"
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == f"{HOST} {digest_of_models()}"


def stage(folder: Path) -> None:
    """Builds into `folder` the files that `setup.py` puts into a wheel of this platform: fmus/ and their sources.

    Raises:
        RuntimeError, ValueError, ImportError: as `cosim.build.build_all`.
    """
    from cosim.build import HOST, build_all, models_of_package

    shutil.rmtree(folder, ignore_errors=True)
    for built in build_all(models_of_package(_MODELS), folder / "fmus"):
        _log.warning("%s", built.file)
    (folder / "fmus" / "built-from").write_text(f"{HOST} {digest_of_models()}", encoding="utf-8")


def _built() -> Path:
    """Returns a copy of the installed systems in the user's cache folder, with FMUs built there."""
    folder = cache_folder() / "shipped" / digest_of_models()[:16]
    if folder.is_dir():
        return folder
    from cosim.build import build_all, models_of_package

    _log.warning("building the FMUs of the shipped systems into %s (once, one to two minutes)", folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f"{folder.name}-", dir=folder.parent))
    try:
        shutil.copytree(_INSTALLED / "master", part / "master")
        for built in build_all(models_of_package(_MODELS), part / "fmus"):
            _log.warning("  %s", built.file.name)
        try:
            part.replace(folder)
        except OSError:  # another process was faster
            if not folder.is_dir():
                raise
    finally:
        shutil.rmtree(part, ignore_errors=True)
    os.utime(folder)
    return folder


if __name__ == "__main__":
    stage(Path(sys.argv[1]))
