"""Source files of a model, and their identity.

The closure of a model is its own module and every module that it imports of its package, of `cosim`, and of packages
made for `cosim`, as `cosim_models` is; those beside it, too, if it is in no package. It is found by reading the
sources; no code is executed. It determines the contents of an interpreted FMU, the FMU's GUID, and whether an FMU is up
to date.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cosim.identity import guid_of
from cosim.model import Model

__all__ = ["Sources", "imported_beside", "sources_of", "sources_of_module"]

_USES_COSIM = re.compile(rb"^(?:from|import) cosim\b", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Sources:
    """The modules of a model: dotted name -> file, and the sha256 digests of their contents."""

    files: Mapping[str, Path]
    digests: Mapping[str, str]
    packages: frozenset[str]

    def guid(self, model_name: str) -> str:
        """Returns a GUID that depends only on the sources and the model's name."""
        return guid_of(model_name, self.digests)


def sources_of(model: type[Model]) -> Sources:
    """Returns the closure of `model`'s module.

    Raises:
        ValueError: a file cannot be found or read.
    """
    return sources_of_module(model.__module__)


def sources_of_module(module: str) -> Sources:
    """Returns the closure of a module that has been imported.

    Raises:
        ValueError: as `sources_of`.
    """
    root = sys.modules[module].__file__
    if root is None:
        raise ValueError(f"{module} has no source file")
    ours = {"cosim", module.partition(".")[0]}
    files: dict[str, Path] = {}
    packages: set[str] = set()
    waiting = {module: Path(root)}
    alone = "." not in module and Path(root).stem == module and not _is_installed(Path(root))
    for name in ("cosim", "cosim.model"):
        if file := _find(name):
            waiting[name] = file
    while waiting:
        name, file = waiting.popitem()
        files[name] = file
        if file.name == "__init__.py":
            packages.add(name)
        for imported in _imports(name, file, file.read_bytes()):
            top = imported.partition(".")[0]
            if top not in ours and top != imported and _is_made_for_cosim(imported):
                ours.add(top)
                waiting[name] = file  # read again: what it imports of this package counts
            if imported in files:
                continue
            if top in ours:
                found = _find(imported)
            else:
                found = _find_beside(Path(root).parent, imported) if alone else None
            if found is not None:
                waiting[imported] = found
    digests = {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in sorted(files.items())}
    return Sources(files, digests, frozenset(packages))


def _is_installed(file: Path) -> bool:
    return file.parent.name in ("site-packages", "dist-packages")


def _find_beside(folder: Path, name: str) -> Path | None:
    """Returns the file of a module, or of one of a package, in `folder`; None if Python takes it from elsewhere."""
    top = name.partition(".")[0]
    of = getattr(sys.modules.get(top), "__file__", None)
    if of is not None and not Path(of).resolve().is_relative_to(folder.resolve()):
        return None
    if of is None and (top in sys.modules or top in sys.stdlib_module_names):
        return None
    path = folder.joinpath(*name.split("."))
    return next((file for file in (path / "__init__.py", path.with_name(f"{path.name}.py")) if file.is_file()), None)


def imported_beside(file: Path) -> dict[str, Path]:
    """Returns the modules and packages in the folder of `file` whose names it imports -> their files."""
    try:
        nodes = [*_statements(ast.parse(file.read_bytes()).body)]
    except (SyntaxError, ValueError):  # told when the file is run
        return {}
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module and not node.level}
    tops = sorted({name.partition(".")[0] for name in names})
    places = {top: (file.parent / top / "__init__.py", file.parent / f"{top}.py") for top in tops}
    return {top: found for top, files in places.items() if (found := next(filter(Path.is_file, files), None))}


def _find(name: str) -> Path | None:
    """Returns the file of a module, or None if `name` is an attribute of a module."""
    try:
        spec = importlib.util.find_spec(name)
    except (ModuleNotFoundError, ValueError):
        return None
    return Path(spec.origin) if spec and spec.origin else None


@cache
def _is_made_for_cosim(module: str) -> bool:
    """Returns whether a module of a package itself imports `cosim`."""
    file = _find(module)
    return file is not None and file.is_file() and _USES_COSIM.search(file.read_bytes()) is not None


@cache
def _imports(name: str, file: Path, text: bytes) -> frozenset[str]:
    """Returns every dotted name that `file`, which contains `text`, may import, including parent packages."""
    names = {name}
    for node in _statements(ast.parse(text, str(file)).body):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise ValueError(f"{file}:{node.lineno}: write absolute imports; an FMU's modules are top-level")
            assert node.module is not None
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    found = {".".join(parts[:i]) for n in names if (parts := n.split(".")) for i in range(1, len(parts) + 1)}
    return frozenset(found - {name})


def _statements(nodes: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yields statements, also those within others. Most nodes of a module are expressions, which import nothing."""
    for node in nodes:
        yield node
        for field in ("body", "orelse", "handlers", "finalbody", "cases"):
            yield from _statements(getattr(node, field, ()))
