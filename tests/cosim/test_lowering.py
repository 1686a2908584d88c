"""Kernels that call each other are one piece of machine code; what is made of them once is found again."""

from __future__ import annotations

import gc
import hashlib
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cosim.kept import made_once, read_kept, write_kept
from cosim.kernel import kernel
from tests.cosim.forked import Forked

numba = pytest.importorskip("numba")

from cosim import lowering  # noqa: E402

pytestmark = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")


@kernel
def doubled(x: float) -> float:
    return 2.0 * x


@kernel
def doubled_and_one(x: float) -> float:
    return doubled(x) + 1.0


@kernel
def factorial(n: int) -> int:
    return 1 if n <= 1 else n * factorial(n - 1)


@kernel
def is_even(n: int) -> bool:
    return True if n == 0 else is_odd(n - 1)


@kernel
def is_odd(n: int) -> bool:
    return False if n == 0 else is_even(n - 1)


@kernel
def refuses(x: float) -> float:
    if x < 0.0:
        raise ValueError("it is negative")
    return x


@kernel
def passes_on(x: float) -> float:
    return refuses(x)


def test_machine_code_is_made_of_what_python_calls_only() -> None:
    assert doubled_and_one(3.0) == 7.0
    assert len(doubled_and_one.overloads) == 1
    assert not doubled.overloads
    assert doubled(3.0) == 6.0
    assert len(doubled.overloads) == 1


def test_a_kernel_may_call_itself_and_those_that_call_it() -> None:
    assert factorial(10) == 3628800
    assert [is_odd(n) for n in (0, 1, 2, 7)] == [False, True, False, True]
    assert [is_even(n) for n in (0, 1, 2, 7)] == [True, False, True, False]


def test_an_exception_of_a_callee_reaches_python() -> None:
    assert passes_on(1.0) == 1.0
    with pytest.raises(ValueError, match="it is negative"):
        passes_on(-1.0)


def test_functions_that_are_no_kernels_may_call_one() -> None:
    @numba.njit
    def total(values):  # type: ignore[no-untyped-def]
        found = 0.0
        for value in values:
            found += doubled_and_one(value)
        return found

    assert total(np.array([1.0, 2.0])) == 8.0


CALL = "import sys; sys.path.insert(0, sys.argv[1]); from garden.bed import watered; print(watered(1.5))"
BED = """from cosim.kept import made_once, read_kept, write_kept
from cosim.kernel import kernel
from garden.can import FILL

@kernel
def poured(x):
    return FILL * x

@kernel
def watered(x):
    return poured(x) + 1.0
"""


BOTH = """
@kernel
def both(x):
    return watered(x) + poured(x)
"""
FIRST_CALL = "from garden.bed import watered; print(watered(1.5))"
BOTH_CALL = "from garden.bed import both; print(both(1.5))"


class Garden:
    """A package whose kernel processes of their own call."""

    def __init__(self, folder: Path, forked: Forked) -> None:
        self.folder, self._forked = folder, forked
        (folder / "garden").mkdir()
        for name, text in (("__init__", ""), ("bed", BED), ("can", "FILL = 2.0\n")):
            (folder / "garden" / f"{name}.py").write_text(text)

    def watered(
        self, cache: str, notes: list[str] | None = None, *, fork: bool = True, **variables: str
    ) -> tuple[str, set[str]]:
        """What a process prints, and the names of the files in its cache folder; `notes` gets its stderr."""
        environment = {**os.environ, "XDG_CACHE_HOME": str(self.folder / cache), **variables}
        if fork:
            done = self._forked.run(CALL, str(self.folder), environment=environment)
        else:
            command = [sys.executable, "-B", "-c", CALL, str(self.folder)]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        if notes is not None:
            notes.append(done.stderr)
        found = (self.folder / cache).rglob("*.kernel")
        return done.stdout, {f"{file.parent.name}/{file.name}" for file in found}


@pytest.fixture
def garden(tmp_path: Path, forked_builder: Forked) -> Garden:
    return Garden(tmp_path, forked_builder)


def test_code_is_looked_for_in_the_package_then_in_the_cache_and_never_for_other_sources(garden: Garden) -> None:
    folder = garden.folder
    printed, first = garden.watered("one")
    assert printed == "4.0\n"
    assert {name.rpartition("/")[2].partition("-")[0] for name in first} == {"watered"}
    assert garden.watered("one", fork=False) == ("4.0\n", first)  # nor does its name depend on the hash seed
    shutil.copytree(folder / "one/uav-cosim/kernels", folder / "garden/compiled")
    assert garden.watered("two") == ("4.0\n", set())  # the package brings it
    (folder / "garden/can.py").write_text("FILL = 3.0\n")
    printed, other = garden.watered("two")
    assert printed == "5.5\n"
    assert len(other) == 1
    assert not other & first


def test_what_is_taken_from_another_package_for_cosim_is_part_of_the_sources(garden: Garden) -> None:
    """The code was that of before when a package beside the kernel's was changed, such as by a new version."""
    folder = garden.folder
    (folder / "shed").mkdir()
    for name, text in (("__init__", ""), ("tap", "from cosim.kernel import kernel\nFLOW = 3.0\n")):
        (folder / "shed" / f"{name}.py").write_text(text)
    can = folder / "garden/can.py"
    can.write_text("from shed.tap import FLOW as FILL\n")
    printed, first = garden.watered("cache")
    assert printed == "5.5\n"
    tap = folder / "shed/tap.py"
    tap.write_text(tap.read_text().replace("3.0", "5.0"))
    printed, both = garden.watered("cache")
    assert printed == "8.5\n"
    assert first < both


def test_sources_of_others_may_have_any_encoding_or_no_file(garden: Garden) -> None:
    (garden.folder / "old").mkdir()
    (garden.folder / "old/__init__.py").touch()
    (garden.folder / "old/names.py").write_bytes("# -*- coding: latin-1 -*-\nNAME = 'Gie\xdfkanne'\n".encode("latin-1"))
    can = garden.folder / "garden/can.py"
    can.write_text("from old.names import NAME\nfrom __main__ import __name__ as begun\nFILL = 2.0 * (len(NAME) > 1)\n")
    assert garden.watered("cache", fork=False)[0] == "4.0\n"


def test_code_for_a_debugger_is_not_taken_for_optimised_code(garden: Garden) -> None:
    printed, slow = garden.watered("cache", fork=False, NUMBA_OPT="0")
    assert printed == "4.0\n"
    printed, both = garden.watered("cache", fork=False)
    assert printed == "4.0\n"
    assert len(both) == 2
    assert slow < both


@pytest.mark.parametrize("place", ["digest", "code", "last byte", "truncated", "empty"])
def test_changed_code_is_made_anew_and_never_loaded(garden: Garden, place: str) -> None:
    notes: list[str] = []
    printed, (name,) = garden.watered("cache", notes)
    assert (printed, notes) == ("4.0\n", [""])
    file = garden.folder / "cache/uav-cosim/kernels" / name
    whole = file.read_bytes()
    assert hashlib.sha256(whole[32:]).digest() == whole[:32]
    if place in ("truncated", "empty"):
        file.write_bytes(whole[: len(whole) // 2 if place == "truncated" else 0])
    else:
        at = {"digest": 3, "code": len(whole) // 2, "last byte": len(whole) - 1}[place]
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    assert garden.watered("cache", notes) == ("4.0\n", {name})
    assert notes[1] == f"note: {file} has been changed since it was made: its code is not loaded, but made anew\n"
    remade = file.read_bytes()
    assert hashlib.sha256(remade[32:]).digest() == remade[:32]
    assert garden.watered("cache", notes) == ("4.0\n", {name})
    assert notes[2] == ""
    assert file.read_bytes() == remade  # which was loaded
    assert [path.name for path in file.parent.iterdir() if path.suffix != ".lowered"] == [file.name]


def test_code_that_nobody_has_written_with_a_digest_is_not_unpickled(garden: Garden, tmp_path: Path) -> None:
    """Pickled objects are code: a file that runs some when it is unpickled, in the place of a kernel."""
    _, (name,) = garden.watered("cache")
    file = tmp_path / "cache/uav-cosim/kernels" / name
    command = f"touch {tmp_path / 'unpickled'}".encode()
    file.write_bytes(b"cposix\nsystem\n(S'" + command + b"'\ntR.")
    pickle.loads(file.read_bytes())
    assert (tmp_path / "unpickled").exists()  # this is such a file
    (tmp_path / "unpickled").unlink()
    assert garden.watered("cache")[0] == "4.0\n"
    assert not (tmp_path / "unpickled").exists()


WAITING_CALL = """
import sys, time, types
import cosim.kept
from cosim.lowering import _ForPython

def sleep(seconds):
    print("waits", flush=True)
    time.sleep(seconds)

def compiles(self, *arguments):
    raise AssertionError("it compiles")

cosim.kept.time = types.SimpleNamespace(sleep=sleep, monotonic=time.monotonic)
_ForPython._compile_core = compiles
"""


def test_code_that_another_process_makes_is_waited_for(garden: Garden, tmp_path: Path) -> None:
    """Parts of a run, tests and campaigns start together: one of them compiles, and the others load its code."""
    _, (name,) = garden.watered("cache")
    file = tmp_path / "cache/uav-cosim/kernels" / name
    code = read_kept(file)
    assert code is not None
    file.unlink()
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [sys.executable, "-c", WAITING_CALL + CALL, str(tmp_path)]
    with made_once(file):
        child = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert child.stdout is not None
        assert child.stdout.readline() == "waits\n"
        write_kept(file, code)
    printed, errors = child.communicate(timeout=600)
    assert child.returncode == 0, errors
    assert printed.splitlines()[-1] == "4.0"
    assert [path.name for path in file.parent.iterdir() if path.suffix != ".lowered"] == [file.name]


LOWERED_CALL = """
import sys; sys.path.insert(0, sys.argv[1])
from cosim import lowering
from cosim.fields import get_real
lower = lowering._Lowerer._compile_core
def noting(self, *arguments):
    print("lowers", self.py_func.__qualname__)
    return lower(self, *arguments)
lowering._Lowerer._compile_core = noting
from garden import bed
bed.watered.lower((lowering.types.float64,))
from cosim.build.native.checks import checked
checked(bed.watered).lower((lowering.types.float64,))
lent = bed.lent(bed.poured)
lent.lower((lowering.types.float64,))
print(lent(1.5))
"""
LENT = """
def lent(used):
    @kernel
    def lending(x):
        return used(x) + seldom(x)
    return lending

def of(factor):
    @kernel
    def inner(x):
        return factor * x
    return inner

inner = of(4.0)

@kernel
def seldom(x):
    return inner(x)
"""
"""Closures depend on the process, and so does a kernel that calls one."""


ROW = """
@kernel
def row(cans, n):
    return cans[1][n]
"""
ROW_CALL = """
import sys; sys.path.insert(0, sys.argv[1])
import numpy as np
from garden.bed import row
print(row((np.zeros(3, np.int32), np.arange(3.0)), 2))
"""

BY_PATH_CALL = """
import sys; sys.path.insert(0, sys.argv[1])
from importlib.util import module_from_spec, spec_from_file_location
from cosim import lowering
spec = spec_from_file_location(sys.argv[2], f"{sys.argv[1]}/garden/bed.py")
bed = sys.modules[sys.argv[2]] = module_from_spec(spec)
spec.loader.exec_module(bed)
lowered = bed.watered.lower((lowering.types.float64,))
print(lowered.name in [f.name for f in lowering.link([lowered.library]).functions if not f.is_declaration])
"""


class TestLoweredKernels:
    """IR is found again by other processes, and only if it is that of the same sources and passes."""

    ALL = ("watered", "poured", "watered", "poured", "of.<locals>.inner", "seldom", "lent.<locals>.lending")
    """A checked kernel is another one."""

    @pytest.fixture
    def lowers(self, garden: Garden, forked_builder: Forked) -> Callable[..., tuple[list[str], str]]:
        bed = garden.folder / "garden/bed.py"
        bed.write_text(bed.read_text() + LENT)

        def run(cache: str = "cache") -> tuple[list[str], str]:
            """Which functions a process lowers, and its stderr; it computes the same every time."""
            environment = {**os.environ, "XDG_CACHE_HOME": str(garden.folder / cache)}
            done = forked_builder.run(LOWERED_CALL, str(garden.folder), environment=environment)
            assert done.returncode == 0, done.stderr
            *lowered, computed = done.stdout.splitlines()
            assert computed == "9.0"
            return [line.removeprefix("lowers ") for line in lowered], done.stderr

        return run

    def test_kernels_of_packages_are_lowered_once(self, lowers: Callable[..., tuple[list[str], str]]) -> None:
        first, _ = lowers()
        assert sorted(first) == sorted(self.ALL)
        again, notes = lowers()
        assert sorted(again) == sorted(self.ALL[4:])
        assert notes == ""

    @pytest.mark.parametrize("damage", ["changed", "callee changed", "callee missing"])
    def test_what_is_damaged_or_missing_is_lowered_again(
        self, lowers: Callable[..., tuple[list[str], str]], tmp_path: Path, damage: str
    ) -> None:
        lowers()
        name = "watered" if damage == "changed" else "poured"
        files = sorted((tmp_path / "cache").rglob(f"{name}-*.lowered"))
        assert len(files) == 2
        whole = {file: file.read_bytes() for file in files}
        for file in files:
            if damage == "callee missing":
                file.unlink()
            else:
                file.write_bytes(whole[file][:-1] + bytes([whole[file][-1] ^ 1]))
        again, notes = lowers()
        redone = ["watered"] * 2 if damage == "changed" else ["watered", "poured"] * 2
        assert sorted(again) == sorted([*redone, *self.ALL[4:]])
        assert ("has been changed since it was made" in notes) == (damage != "callee missing")
        if damage == "callee missing":
            assert [file.exists() for file in files] == [True, True]
        assert sorted(lowers()[0]) == sorted(self.ALL[4:])

    @pytest.mark.parametrize("package", ["garden", "shed"])
    def test_other_sources_are_lowered_anew(
        self, lowers: Callable[..., tuple[list[str], str]], tmp_path: Path, package: str
    ) -> None:
        """What a kernel takes from another module of its package, or of another package for `cosim`, is part of it."""
        (tmp_path / "shed").mkdir()
        for name, text in (("__init__", ""), ("tap", "from cosim.kernel import kernel\nFLOW = 2.0\n")):
            (tmp_path / "shed" / f"{name}.py").write_text(text)
        can = tmp_path / "garden/can.py"
        can.write_text("from shed.tap import FLOW as FILL\n")
        lowers()
        other = can if package == "garden" else tmp_path / "shed/tap.py"
        other.write_text(other.read_text() + "LEFT = 1.0\n")
        assert sorted(lowers()[0]) == sorted(self.ALL)

    def test_a_process_that_lowers_nothing_makes_machine_code_for_python(self, garden: Garden) -> None:
        bed = garden.folder / "garden/bed.py"
        bed.write_text(bed.read_text() + ROW)
        environment = {**os.environ, "XDG_CACHE_HOME": str(garden.folder / "cache")}
        for _ in range(2):
            command = [sys.executable, "-B", "-c", ROW_CALL, str(garden.folder)]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            assert (done.stdout, done.stderr) == ("2.0\n", "")
            assert list((garden.folder / "cache").rglob("*.lowered"))
            (made,) = (garden.folder / "cache").rglob("*.kernel")
            made.unlink()

    def test_a_module_may_be_imported_under_another_name(self, garden: Garden, forked_builder: Forked) -> None:
        """`uav-cosim build garden/bed.py` imports it by its path. Nothing is linked that callers call otherwise."""
        environment = {**os.environ, "XDG_CACHE_HOME": str(garden.folder / "cache")}
        for name in ("garden.bed", "bed", "garden.bed"):
            done = forked_builder.run(BY_PATH_CALL, str(garden.folder), name, environment=environment)
            assert (done.stdout, done.stderr) == ("True\n", ""), name

    @pytest.mark.parametrize("loss", ["emptied", "another"])
    def test_the_cache_may_be_emptied_or_change_during_a_process(
        self, garden: Garden, forked_builder: Forked, loss: str
    ) -> None:
        """As in a notebook: what was read is linked with what is lowered, or read elsewhere, later."""

        def run(program: str, cache: Path) -> tuple[str, str]:
            environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
            done = forked_builder.run(program, paths=(garden.folder,), environment=environment)
            assert done.returncode == 0, done.stderr
            return done.stdout, done.stderr

        bed = garden.folder / "garden/bed.py"
        bed.write_text(bed.read_text() + BOTH)
        caches = [garden.folder / name for name in ("cache", "other")]
        for cache in caches:
            run(FIRST_CALL, cache)
            for made in cache.rglob("*.kernel"):
                made.unlink()
        then = f"shutil.rmtree({str(caches[0])!r})"
        if loss == "another":
            then = f"os.environ['XDG_CACHE_HOME'] = {str(caches[1])!r}"
        assert run(f"import os, shutil; {FIRST_CALL}; {then}; {BOTH_CALL}", caches[0]) == ("4.0\n7.0\n", "")

    def test_they_are_made_where_nothing_can_be_written(
        self, lowers: Callable[..., tuple[list[str], str]], tmp_path: Path
    ) -> None:
        (tmp_path / "file").touch()
        for _ in range(2):
            assert sorted(lowers("file")[0]) == sorted(self.ALL)


def test_code_is_made_where_no_file_can_be_locked(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with made_once(tmp_path / "file" / "below.kernel"):
        pass
    with made_once(tmp_path / "new" / "a.kernel"), pytest.raises(ValueError), made_once(tmp_path / "new" / "b.kernel"):
        assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["a.lock", "b.lock"]
        raise ValueError
    assert not list((tmp_path / "new").iterdir())


def test_the_collector_goes_on_where_it_was() -> None:
    """What others have frozen stays so; what is made without the collector is old at once."""
    assert gc.isenabled() and not gc.get_freeze_count()
    with lowering.without_collector():
        made = [[] for _ in range(2 * gc.get_threshold()[0])]  # type: ignore[var-annotated]
        assert not gc.isenabled()
    assert gc.isenabled() and not gc.get_freeze_count()
    assert not any(one is made for one in gc.get_objects(generation=0))
    gc.freeze()
    frozen = gc.get_freeze_count()
    try:
        with lowering.without_collector():
            pass
        assert gc.isenabled() and gc.get_freeze_count() >= frozen - 100  # some of them may have ended
    finally:
        gc.unfreeze()
