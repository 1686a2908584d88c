"""From a model class to an .fmu file: compiled if it has kernels, interpreted otherwise or on request."""

from __future__ import annotations

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
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import active_children, get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from traceback import extract_tb
from types import ModuleType
from typing import Any, TypedDict

from cosim.build.compiled import HOST, TARGETS, CannotCompile, build_compiled
from cosim.build.faults import place
from cosim.build.interpreted import build_interpreted
from cosim.build.sources import Sources, sources_of
from cosim.model import Model

__all__ = ["HOST", "TARGETS", "Built", "CannotCompile", "build", "build_all", "load_models", "models_of_package"]


@dataclass(frozen=True, slots=True)
class Built:
    """The file that `build` wrote, whether it is compiled, and whether it was up to date already."""

    file: Path
    compiled: bool
    fresh: bool


def load_models(source: str) -> list[type[Model]]:
    """The model classes of a Python file or of an importable module (``cosim_models.vehicles.quadrotor``).

    Raises:
        ValueError: there is no such file or module, it defines no model, or another module of that name is loaded.
        Exception: whatever the module raises when it is imported.
    """
    if source.endswith(".py"):
        file = Path(source).resolve()
        if not file.is_file():
            raise ValueError(f"{source}: no such file")
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        if file.stem in sys.modules:
            raise ValueError(f"{source}: a module called {file.stem} is loaded already; give the file another name")
        sys.modules[file.stem] = module
        try:
            spec.loader.exec_module(module)
        except BaseException as error:
            del sys.modules[file.stem]
            lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == str(file)]
            if isinstance(error, ValueError | TypeError) and lines and lines[-1]:
                raise ValueError(f"{place(str(file), lines[-1])}: {error}") from error
            raise
    else:
        try:
            module = importlib.import_module(source)
        except ModuleNotFoundError as error:
            if not f"{source}.".startswith(f"{error.name}."):
                raise  # it is there, and imports what is not
            raise ValueError(f"{source}: no such module") from None
    models = _defined_in(module)
    if not models:
        raise ValueError(f"{source}: no subclass of cosim.Model in it")
    return models


def models_of_package(package: str) -> list[type[Model]]:
    """Every model that a module of `package` defines, by name.

    Raises:
        ImportError: there is no such package.
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
    """Writes ``folder/<Model>.fmu`` (FMI 2) or ``folder/<Model>.fmi3.fmu`` (FMI 3) unless it is there and up to date.

    Args:
        interpreted: pack the sources; its kernels run as plain Python. Models without kernels always do.
        targets: platforms to compile for; an up to date FMU keeps those that it has besides.
        fmi: 2 or 3.
        checked: compile with checks of indices and loops; None: yes, unless the model's package says
            ``CHECKED = False``, as one does that is tested with checks and shipped without.

    Raises:
        ValueError: the declaration is wrong, a target or the FMI version is unknown, or an FMI 3 FMU was to be
            interpreted: pythonfmu packs FMI 2 only.
        CannotCompile: the kernels cannot be compiled, or an FMI 3 FMU was asked for and the model has none.
        RuntimeError: the C compiler failed, or pythonfmu brings no binaries.
    """
    file, compile_it, sources, stamp = _wanted(model, folder, interpreted, targets, fmi, checked)
    if (built := _up_to_date(file, stamp)) is not None:
        return built
    folder.mkdir(parents=True, exist_ok=True)
    if compile_it:
        build_compiled(model, sources, stamp, file, stamp["targets"], fmi, checked=stamp["checked"])
    else:
        build_interpreted(model, sources, stamp, file)
    return Built(file, compile_it, fresh=False)


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
    """As `build`, of several models, in their order; those of packages that are not up to date in processes of their
    own, as many at a time as there are processors. Ctrl-C, any other exception and `close` end these processes.

    Args:
        on_building: is told the names of the models that are being built, whenever they change, by any thread.

    Raises:
        ValueError, CannotCompile, RuntimeError: as `build` does.
    """
    how: dict[str, Any] = {"interpreted": interpreted, "targets": targets, "fmi": fmi, "checked": checked}

    def elsewhere(model: type[Model]) -> bool:
        file, _, _, stamp = _wanted(model, folder, **how)
        return "." in model.__module__ and _up_to_date(file, stamp) is None

    stale = [model for model in models if elsewhere(model)]
    if len(stale) < 2:
        stale = []
    stale.sort(key=_source_size, reverse=True)  # the one that takes longest begins first
    tell = on_building or (lambda _: None)
    workers = max(1, min(len(stale), os.cpu_count() or 1))
    others = set(active_children())
    with (
        TemporaryDirectory(prefix="uav-cosim-builds-") as scratch,
        # Not forked: numba and LLVM have threads and locks.
        ProcessPoolExecutor(workers, get_context("spawn"), _work_in, (scratch,)) as processes,
    ):
        # Ctrl-C is for this process; it ends the others.
        with _interrupts_held(), _path_without_fmus(), _main_hidden():
            building = {model: processes.submit(build, model, folder, **how) for model in stale}
        _follow(building, workers, tell)
        try:
            for model in models:
                if model in building:
                    yield building[model].result()
                else:
                    if not building:
                        tell([model.__name__])
                    yield build(model, folder, **how)
        except BaseException:
            for process in {*active_children()} - others:
                process.terminate()
            raise
        finally:
            processes.shutdown(cancel_futures=True)


@contextmanager
def _path_without_fmus() -> Iterator[None]:
    """Processes that are started meanwhile import nothing from FMUs that this process has loaded.

    pythonfmu's wrapper puts the resources of each Python FMU first on the path, and leaves them there: the FMU's copies
    of pythonfmu (which has no binaries) and of modules of this project would be found before the installed ones.
    """
    before = list(sys.path)
    sys.path[:] = [entry for entry in before if not (Path(entry) / "slavemodule.txt").is_file()]
    try:
        yield
    finally:
        sys.path[:] = before


@contextmanager
def _main_hidden() -> Iterator[None]:
    """Processes that are started meanwhile do not import the main program, which need not be guarded against that.

    What they build is in packages; a program that only calls `simulate` would otherwise be run again in each of them.
    """
    main = sys.modules["__main__"]
    before = {name: value for name, value in vars(main).items() if name in ("__file__", "__spec__")}
    vars(main).update(dict.fromkeys(before))
    try:
        yield
    finally:
        vars(main).update(before)


def _source_size(model: type[Model]) -> int:
    return sum(file.stat().st_size for file in sources_of(model).files.values())


def _work_in(scratch: str) -> None:
    """Temporary files of this process lie in a folder that whoever started it removes."""
    tempfile.tempdir = scratch


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes that are started meanwhile never receive SIGINT; this one does, afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _follow(building: Mapping[type[Model], Future[Built]], workers: int, tell: Callable[[Sequence[str]], None]) -> None:
    """Tell which models are being built: of those that are not done the first ones, in the order of submission."""

    def report(_: Future[Built] | None = None) -> None:
        left = [model.__name__ for model, future in building.items() if not future.done()]
        if left:
            tell(left[:workers])

    for future in building.values():
        future.add_done_callback(report)
    report()


class _Stamp(TypedDict):
    """What an FMU was built from and how: one with the same stamp is up to date."""

    sources: dict[str, str]
    builder: str
    targets: list[str]
    compiler: str
    compiled: bool
    checked: bool


def _wanted(
    model: type[Model], folder: Path, interpreted: bool, targets: Sequence[str], fmi: int, checked: bool | None
) -> tuple[Path, bool, Sources, _Stamp]:
    """The file, whether to compile it, the sources it is made of, and its stamp."""
    if unknown := set(targets) - set(TARGETS):
        raise ValueError(f"target {', '.join(sorted(unknown))}: there are {', '.join(TARGETS)}")
    if fmi not in (2, 3):
        raise ValueError(f"FMI {fmi}: there are 2 and 3")
    if fmi == 3 and interpreted:
        raise ValueError(f"{model.__name__}: interpreted FMUs are FMI 2 only (pythonfmu makes them); leave out one")
    if fmi == 3 and model.kernels is None:
        raise CannotCompile(f"{model.__name__} has no kernels, so it is interpreted, and that is FMI 2 only")
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
    """Changes when this package or one of the tools that it drives does."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.glob("*.[pc]*")):
        if file.is_file():
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
