"""Building .fmu files from model classes: compiled if the model has kernels, otherwise (or on request) interpreted."""

from __future__ import annotations

import gc
import hashlib
import importlib
import importlib.util
import inspect
import json
import os
import pkgutil
import signal
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from multiprocessing import active_children, get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from traceback import extract_tb
from types import ModuleType
from typing import Any, TypedDict

from cosim.build.description import complete, degrees_of
from cosim.build.faults import doubts_of, place, refusals_of, shared_of
from cosim.build.interpreted import build_interpreted
from cosim.build.native.compiled import HOST, TARGETS, CannotCompile, build_compiled
from cosim.build.sources import Sources, imported_beside, sources_of
from cosim.model import Model
from cosim.pages import variables

__all__ = ["HOST", "TARGETS", "Built", "CannotCompile", "build", "build_all", "load_models", "models_of_package"]


@dataclass(frozen=True, slots=True)
class Built:
    """The file written by `build`, whether it is compiled, whether it was already up to date, and doubts about it.

    `doubts` are what its author hardly means: of any model, angles that can only be degrees; of kernels compiled with
    checks, what `doubts_of` finds; of a model without kernels, what its instances share.
    """

    file: Path
    compiled: bool
    fresh: bool
    doubts: tuple[str, ...] = ()


def load_models(source: str) -> list[type[Model]]:
    """Returns the model classes of a Python file or of an importable module (``cosim_models.vehicles.quadrotor``).

    A file finds the modules beside it, as where Python runs it.

    Raises:
        ValueError: the file or module does not exist or defines no model, or another module of its name, or of that of
            one beside it, is loaded.
        ImportError: the module imports something that does not exist.
        Exception: any exception that the module raises on import; of a file, as a ValueError with file and line.
    """
    if source.endswith(".py"):
        file = Path(source).resolve()
        if not file.is_file():
            raise ValueError(f"{source}: no such file")
        if file.stem in _CAME_ALONG and _is_from(sys.modules.get(file.stem), file):
            module = sys.modules[file.stem]
            _CAME_ALONG.remove(file.stem)
        else:
            module = _loaded(source, file)
    else:
        if not all(part.isidentifier() for part in source.split(".")):
            raise ValueError(f"{source}: no such module; give a .py file, or the name of a module")
        try:
            module = importlib.import_module(source)
        except ModuleNotFoundError as error:
            if not f"{source}.".startswith(f"{error.name}."):
                raise  # the module exists, but one of its imports does not
            raise ValueError(f"{source}: no such module") from None
    models = _defined_in(module)
    if not models:
        raise ValueError(f"{source}: it defines no subclass of cosim.Model")
    return models


_CAME_ALONG: set[str] = set()
"""Modules beside files of models that one of these has imported: they may be given as files of models too."""


def _loaded(source: str, file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    if file.stem in sys.modules:
        raise ValueError(f"{source}: a module called {file.stem} is already loaded; rename the file")
    for name, beside in imported_beside(file).items():
        other = sys.modules.get(name)
        ours = name.partition("_")[0] == "cosim"  # a checkout beside the installed one
        if other is not None and not _is_from(other, beside) and name not in sys.stdlib_module_names and not ours:
            of = getattr(other, "__file__", None) or "Python"
            raise ValueError(f"{source}: it imports {name}, but that of {of} is already loaded; rename that beside it")
    before = set(sys.modules)
    sys.modules[file.stem] = module
    sys.path.insert(0, str(file.parent))
    importlib.invalidate_caches()  # for files written a moment ago
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        for name in _beside(file, before):
            del sys.modules[name]
        _raise_with_line(error, file)
        raise
    finally:
        sys.path.remove(str(file.parent))
    _CAME_ALONG.update(_beside(file, {*before, file.stem}))
    return module


def _beside(file: Path, before: Set[str]) -> list[str]:
    """Returns the modules and packages in the folder of `file` that are loaded, without those `before`."""
    loaded = {
        name: Path(of) for name in set(sys.modules) - before if (of := getattr(sys.modules[name], "__file__", None))
    }
    places = {name: file.parent / name.partition(".")[0] for name in loaded}
    return [name for name, of in loaded.items() if places[name] in (of.with_suffix(""), *of.parents)]


def _is_from(module: ModuleType | None, file: Path) -> bool:
    of = getattr(module, "__file__", None)
    return of is not None and Path(of).resolve() == file.resolve()


def _raise_with_line(error: BaseException, file: Path) -> None:
    """Raises what a file or one beside it raised on import, with its line; returns if no line of them is known."""

    def is_own(name: str | None) -> bool:
        return name is not None and Path(name).parent == file.parent

    if isinstance(error, SyntaxError):
        if error.filename and is_own(error.filename) and error.lineno:
            raise ValueError(f"{place(error.filename, error.lineno)}: {error.msg}") from error
        return
    own = [frame for frame in extract_tb(error.__traceback__) if is_own(frame.filename)]
    if not isinstance(error, Exception | SystemExit) or not own or not own[-1].lineno:
        return
    where = place(own[-1].filename, own[-1].lineno)
    if isinstance(error, SystemExit):
        raise ValueError(f"{where}: it ends the program (sys.exit); a file of models only defines them") from error
    if isinstance(error, ImportError):
        raise type(error)(f"{where}: {error}", name=error.name, path=error.path) from error
    kind = "" if isinstance(error, ValueError | TypeError) else f"{type(error).__name__}: "
    raise ValueError(f"{where}: {kind}{error}") from error


def models_of_package(package: str) -> list[type[Model]]:
    """Returns every model defined by a module of `package`, sorted by name.

    Raises:
        ImportError: the package does not exist.
    """
    found = importlib.import_module(package)
    models: list[type[Model]] = []
    for module in pkgutil.walk_packages(found.__path__, f"{package}."):
        loaded = importlib.import_module(module.name)
        models += _defined_in(loaded)
    return sorted(models, key=lambda model: model.__name__)


def _defined_in(module: ModuleType) -> list[type[Model]]:
    classes = (c for _, c in inspect.getmembers(module, inspect.isclass))
    return [c for c in classes if issubclass(c, Model) and c.__module__ == module.__name__]


def build(
    model: type[Model],
    folder: Path,
    *,
    interpreted: bool = False,
    targets: Sequence[str] = (HOST,),
    fmi: int = 2,
    checked: bool | None = None,
) -> Built:
    """Writes ``folder/<Model>.fmu`` (FMI 2) or ``folder/<Model>.fmi3.fmu`` (FMI 3) unless it is already up to date.

    Args:
        interpreted: pack the sources; kernels then run as plain Python. Models without kernels are always interpreted.
        targets: platforms to compile for; an up-to-date FMU keeps any other platforms that it contains.
        fmi: 2 or 3.
        checked: compile with checks of indices and loops. None: yes, unless the model's package sets ``CHECKED =
            False``, as a package does that is tested with checks and shipped without.

    Raises:
        ValueError: the declaration is wrong, a target or the FMI version is unknown, an interpreted FMI 3 FMU was
            requested (pythonfmu supports FMI 2 only), or a kernel of an interpreted FMU returns a bool for an int.
        CannotCompile: the kernels cannot be compiled, or an FMI 3 FMU was requested for a model without kernels.
        RuntimeError: the C compiler failed, pythonfmu contains no binaries, or the FMU cannot be written.
    """
    file, compile_it, sources, stamp = _wanted(model, folder, interpreted, targets, fmi, checked)
    doubts = _doubts(model, stamp)
    if (built := _up_to_date(file, stamp)) is not None:
        return replace(built, doubts=doubts)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not compile_it and model.kernels is not None and (refusals := refusals_of(model)):
            raise ValueError("\n".join(f"{model.__name__}: {text}" for text in refusals))
        if compile_it:
            build_compiled(model, sources, stamp, file, stamp["targets"], fmi, checked=stamp["checked"])
        else:
            build_interpreted(model, sources, stamp, file)
    except OSError as error:
        raise RuntimeError(f"{error.filename or file}: cannot be written: {error.strerror or error}") from error
    return Built(file, compile_it, fresh=False, doubts=doubts)


def build_all(
    models: Sequence[type[Model]],
    folder: Path,
    *,
    interpreted: bool = False,
    targets: Sequence[str] = (HOST,),
    fmi: int = 2,
    checked: bool | None = None,
    on_building: Callable[[Sequence[str]], None] | None = None,
) -> Iterator[Built]:
    """Builds several models like `build`, and returns the results in their order.

    Models of packages that are not up to date are built in separate processes, one per processor at a time. Ctrl-C, any
    other exception and `close` end these processes.

    Args:
        on_building: called with the names of the models being built whenever they change, from any thread.

    Raises:
        ValueError, CannotCompile, RuntimeError: as `build` does.
    """
    how: dict[str, Any] = {"interpreted": interpreted, "targets": targets, "fmi": fmi, "checked": checked}

    fresh: dict[type[Model], Built] = {}
    stale: list[type[Model]] = []
    for model in models:
        file, _, _, stamp = _wanted(model, folder, **how)
        built = _up_to_date(file, stamp)
        if built is None:
            stale += [model] if "." in model.__module__ else []
        else:
            fresh[model] = replace(built, doubts=_doubts(model, stamp))
    if len(stale) < 2:
        stale = []
    stale.sort(key=_source_size, reverse=True)  # the longest build starts first
    tell = on_building or (lambda _: None)
    workers = max(1, min(len(stale), os.cpu_count() or 1))
    others = set(active_children())
    with (
        TemporaryDirectory(prefix="uav-cosim-builds-") as scratch,
        # Not forked, because numba and LLVM hold threads and locks.
        ProcessPoolExecutor(workers, get_context("spawn"), _work_in, (scratch,)) as processes,
    ):
        # Ctrl-C is delivered to this process only; it ends the others.
        with _interrupts_held(), _path_without_fmus(), _main_hidden(), _in_large_pages():
            building = {model: processes.submit(build, model, folder, **how) for model in stale}
        _follow(building, workers, tell)
        try:
            for model in models:
                if model in building:
                    yield building[model].result()
                else:
                    if not building:
                        tell([model.__name__])
                    yield fresh[model] if model in fresh else build(model, folder, **how)
        except BaseException:
            for process in {*active_children()} - others:
                process.terminate()
            raise
        finally:
            processes.shutdown(cancel_futures=True)


def _doubts(model: type[Model], stamp: _Stamp) -> tuple[str, ...]:
    of_kernels = doubts_of(model) if stamp["checked"] else [] if model.kernels is not None else shared_of(model)
    return (*degrees_of(model), *of_kernels)


@contextmanager
def _path_without_fmus() -> Iterator[None]:
    """Prevents processes started within from importing modules of FMUs that this process has loaded.

    pythonfmu's wrapper puts the resources of each Python FMU first on the path and leaves them there. The FMU's copies
    of pythonfmu (which has no binaries) and of this project's modules would be found before the installed ones.
    """
    before = list(sys.path)
    sys.path[:] = [entry for entry in before if not (Path(entry) / "slavemodule.txt").is_file()]
    try:
        yield
    finally:
        sys.path[:] = before


@contextmanager
def _main_hidden() -> Iterator[None]:
    """Prevents processes started within from importing the main program, so that it needs no guard.

    They build models of packages only. Otherwise, a program that just calls `simulate` would run again in each process.
    """
    main = sys.modules["__main__"]
    before = {name: value for name, value in vars(main).items() if name in ("__file__", "__spec__")}
    vars(main).update(dict.fromkeys(before))
    try:
        yield
    finally:
        vars(main).update(before)


@contextmanager
def _in_large_pages() -> Iterator[None]:
    """Gives processes started within their memory in large pages, which takes up to two fifths of their time away."""
    given = variables()
    os.environ.update(given)
    try:
        yield
    finally:
        for name in given:
            del os.environ[name]


def _source_size(model: type[Model]) -> int:
    return sum(file.stat().st_size for file in sources_of(model).files.values())


def _work_in(scratch: str) -> None:
    """Places temporary files of this process in a folder that the parent process removes.

    Garbage is seldom looked for: what a compilation makes stays until its end, and looking through it took a twentieth
    of its time.
    """
    tempfile.tempdir = scratch
    gc.set_threshold(50_000, 20, 50)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Blocks SIGINT for processes started within; this process receives it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _follow(building: Mapping[type[Model], Future[Built]], workers: int, tell: Callable[[Sequence[str]], None]) -> None:
    """Reports which models are being built: the first unfinished ones, in order of submission."""

    def report(_: Future[Built] | None = None) -> None:
        left = [model.__name__ for model, future in building.items() if not future.done()]
        if left:
            tell(left[:workers])

    for future in building.values():
        future.add_done_callback(report)
    report()


class _Stamp(TypedDict):
    """The inputs of a build: an FMU with the same stamp is up to date."""

    sources: dict[str, str]
    builder: str
    targets: list[str]
    compiler: str
    compiled: bool
    checked: bool


def _wanted(
    model: type[Model], folder: Path, interpreted: bool, targets: Sequence[str], fmi: int, checked: bool | None
) -> tuple[Path, bool, Sources, _Stamp]:
    """Returns the file, whether to compile it, its sources, and its stamp."""
    if unknown := set(targets) - set(TARGETS):
        raise ValueError(f"target {', '.join(sorted(unknown))}: not available; valid: {', '.join(TARGETS)}")
    if fmi not in (2, 3):
        raise ValueError(f"FMI {fmi}: not supported; valid: 2 and 3")
    if fmi == 3 and interpreted:
        raise ValueError(f"{model.__name__}: interpreted FMUs are FMI 2 only (pythonfmu makes them); leave out one")
    if fmi == 3 and model.kernels is None:
        raise CannotCompile(f"{model.__name__} has no kernels, so it is interpreted, and that is FMI 2 only")
    complete(model)
    file = folder / (f"{model.__name__}.fmi3.fmu" if fmi == 3 else f"{model.__name__}.fmu")
    sources = sources_of(model)
    compile_it = model.kernels is not None and not interpreted
    if compile_it and not (os.environ.get("CC") or importlib.util.find_spec("ziglang")):
        raise ValueError("a compiled FMU needs a C compiler; try pip install 'uav-cosim[build]', or set CC")
    every = set(targets) | (set((_stamp_of(file) or {}).get("targets", ())) & set(TARGETS)) if compile_it else set()
    if checked is None:
        package = sys.modules.get(model.__module__.partition(".")[0])
        checked = bool(getattr(package, "CHECKED", True))
    stamp: _Stamp = {
        "sources": dict(sources.digests),
        "builder": _builder_digest(),
        "targets": sorted(every),
        "compiler": os.environ.get("CC", "") if HOST in every else "",
        "compiled": compile_it,
        "checked": checked and compile_it,
    }
    return file, compile_it, sources, stamp


def _up_to_date(file: Path, stamp: _Stamp) -> Built | None:
    return Built(file, stamp["compiled"], fresh=True) if _stamp_of(file) == stamp else None


def _builder_digest() -> str:
    """Returns a digest that changes with this package and with the versions of its tools."""
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for file in (package.with_name("identity.py"), *sorted(package.rglob("*"))):
        if file.suffix in {".py", ".c", ".h"}:
            digest.update(file.read_bytes())
    for tool in ("numba", "llvmlite", "numpy", "pythonfmu", "ziglang"):
        if importlib.util.find_spec(tool) is not None:
            digest.update(f"{tool} {version(tool)}".encode())
    return digest.hexdigest()


def _stamp_of(file: Path) -> dict[str, Any] | None:
    try:
        with zipfile.ZipFile(file) as archive:
            stamp = json.loads(archive.read("resources/build.json"))
            return stamp if isinstance(stamp, dict) else None
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):
        return None
