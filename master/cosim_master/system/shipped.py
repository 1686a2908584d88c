"""The systems that come with this project, by name: ``line5`` stands for the folder of that name.

A source tree has them in master/systems; they take their FMUs from fmus/, where `make fmus` writes them. An installed
package has a copy of both folders beside this module (`setup.py` puts them into the wheel). A wheel without FMUs, or
one whose Python sources have been changed since, gets a copy in the user's cache folder, one for each state of the
sources, and its FMUs are built there once.

`python -m cosim_master.system.shipped FOLDER` builds what a wheel carries besides the systems; `make wheel` calls it.
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
    """The names of the systems, sorted."""
    systems = _root() / "master" / "systems"
    return tuple(sorted(path.parent.name for path in systems.glob("*/SystemStructure.ssd")))


def find(name: str) -> Path | None:
    """The folder of the system `name`, its FMUs in place; None where no system of this name is shipped.

    In a source tree nothing is built here: `make fmus` does it.

    Raises:
        RuntimeError: FMUs have to be built and the C compiler failed.
        ValueError, ImportError: as `cosim.build.build_all`.
    """
    return _ready() / "master" / "systems" / name if name in names() else None


def document(system: str, name: str) -> Path:
    """Returns the document `name` of a shipped system, whose FMUs need not exist."""
    return _root() / "master" / "systems" / system / name


def fmus() -> Path:
    """The folder with the FMUs of the shipped systems.

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
    """Returns the starting points for models of one's own, files with the text of a model, by kind."""
    folder = Path(str(import_module(_MODELS).__file__)).parent / "templates"
    return {file.stem: file for file in sorted(folder.glob("*.txt"))}


def _ready() -> Path:
    """The folder that holds master/systems and, unless it is a source tree without them, fmus."""
    root = _root()
    return _built() if root == _INSTALLED and not _has_own_fmus() else root


def digest_of_models() -> str:
    """The digest of all sources that FMUs are built from."""
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
    """A copy of the installed systems in the user's cache folder, with FMUs that were built there."""
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
