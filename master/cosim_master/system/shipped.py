"""The systems that are part of this project, by name: ``line5`` is the folder of that name.

In a source tree, they are in master/systems; their FMUs are in fmus/, where `make fmus` writes all of them and a
missing one is built when it is needed. An installed package has a copy of both folders next to this module (`setup.py`
puts them into the wheel). If a wheel has no FMUs, or if its Python sources have been changed since, a copy is made in
the user's cache folder for each state of the sources, and FMUs are built there when they are first needed.

`python -m cosim_master.system.shipped FOLDER` builds the other files of a wheel; `make wheel` calls it.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Collection, Set
from importlib import import_module
from pathlib import Path

from lxml import etree

from cosim.kernel import cache_folder
from cosim.verdict import Values

__all__ = [
    "accepting",
    "digest_of_models",
    "document",
    "find",
    "fmu",
    "fmus",
    "is_shipped",
    "models",
    "names",
    "stage",
    "templates",
]

_PACKAGE = Path(__file__).parents[1]
_INSTALLED = _PACKAGE / "shipped"
_MODELS = "cosim_models"
_FMUS = "../../../fmus/"
"""The folder of the FMUs as the systems name it."""
_log = logging.getLogger(__name__)


def names() -> tuple[str, ...]:
    """Returns the names of the systems, sorted."""
    systems = _root() / "master" / "systems"
    return tuple(sorted(path.parent.name for path in systems.glob("*/SystemStructure.ssd")))


def find(name: str) -> Path | None:
    """Returns the folder of the system `name`, with its FMUs; None if no system of this name is shipped.

    FMUs of the system that do not exist are built.

    Raises:
        RuntimeError: FMUs must be built and the C compiler failed.
        ValueError, ImportError: as for `cosim.build.build_all`.
    """
    if name not in names():
        return None
    root = _ready()
    _build_missing(root, models(name))
    return root / "master" / "systems" / name


def is_shipped(folder: Path) -> bool:
    """Returns whether a folder is the one that `find` returns for a system."""
    return folder.name in names() and folder == _ready() / "master" / "systems" / folder.name


def document(system: str, name: str) -> Path:
    """Returns the document `name` of a shipped system, whose FMUs need not exist."""
    return _root() / "master" / "systems" / system / name


def fmus() -> Path:
    """Returns the folder with those FMUs of the project's models that have been built."""
    return _ready() / "fmus"


def fmu(model: str) -> Path | None:
    """Returns the FMU of the model with this name, which is built if it does not exist; None if there is no such model.

    Raises:
        RuntimeError, ValueError, ImportError: as `find`.
    """
    if not model.isidentifier():
        return None
    root = _ready()
    _build_missing(root, (model,))
    file = root / "fmus" / f"{model}.fmu"
    return file if file.is_file() else None


def accepting(port: str, values: Set[int]) -> Path | None:
    """Returns an FMU whose input `port` is declared to accept these values (`cosim.verdict.Values`), or None.

    It is built if it does not exist.

    Raises:
        RuntimeError, ValueError, ImportError: as `find`.
    """
    from cosim.build import models_of_package

    for model in sorted(models_of_package(_MODELS), key=lambda model: model.kernels is None):  # compiled ones first
        for variable in model.variables:
            accepted = variable.verdict if variable.name == port and variable.role == "input" else None
            if isinstance(accepted, Values) and values <= set(accepted.values):
                return fmu(model.__name__)
    return None


def models(system: str) -> tuple[str, ...]:
    """Returns the names of the FMUs in fmus/ that a shipped system consists of, sorted."""
    waiting = [(_root() / "master" / "systems" / system / "SystemStructure.ssd").resolve()]
    read: set[Path] = set()
    found: set[str] = set()
    while waiting:
        if (ssd := waiting.pop()) not in read:
            read.add(ssd)
            sources = [component.get("source", "") for component in etree.parse(str(ssd)).iter("{*}Component")]
            waiting += [(ssd.parent / source).resolve() for source in sources if source.endswith(".ssd")]
            found |= {Path(source).stem for source in sources if source.startswith(_FMUS)}
    return tuple(sorted(found))


def templates() -> dict[str, Path]:
    """Returns the starting points for new models, which are files with the text of a model, by kind."""
    folder = Path(str(import_module(_MODELS).__file__)).parent / "templates"
    return {file.stem: file for file in sorted(folder.glob("*.txt"))}


def _ready() -> Path:
    """Returns the folder that contains master/systems and, unless it is a source tree without them, fmus."""
    root = _root()
    return _built() if root == _INSTALLED and not _has_own_fmus() else root


def _build_missing(root: Path, names: Collection[str]) -> None:
    """Builds the FMUs with these names that do not exist in the folder fmus of `root` and are models of the project."""
    missing = [name for name in names if not (root / "fmus" / f"{name}.fmu").exists()]
    if not missing:
        return
    from cosim.build import build_all, models_of_package

    known = [model for model in models_of_package(_MODELS) if model.__name__ in missing]
    if known:
        _log.warning("building %s (once)", ", ".join(model.__name__ for model in known))
        for _ in build_all(known, root / "fmus"):
            pass


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
    """Returns a copy of the installed systems in the user's cache folder, where their FMUs are built when needed."""
    folder = cache_folder() / "shipped" / digest_of_models()[:16]
    if folder.is_dir():
        return folder
    _log.warning("the FMUs of shipped systems are built into %s when they are first needed", folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f"{folder.name}-", dir=folder.parent))
    try:
        shutil.copytree(_INSTALLED / "master", part / "master")
        (part / "fmus").mkdir()
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
