"""FMUs whose process is connected by TCP (portable.c), here as on Windows and macOS, and FMUs of Windows run by Wine.

On Linux, the program runs FMUs of Linux, too, so that the tests of its messages need no other system. The last test
needs Wine, whose first start for a user takes a minute.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import fmpy
import fmpy.fmi2
import pyarrow.parquet as pq
import pytest

from cosim.build import HOST, build, load_models
from cosim.build.native.compiled import TARGETS
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation import isolating
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import RUNNER, describe
from cosim_master.fmi.isolation import building, child, runner
from cosim_master.fmi.isolation.building import connecting, portable
from cosim_master.fmi.isolation.child import Limits, loaded
from cosim_master.fmi.slaves import isolated
from cosim_master.fmi.slaves.isolated import Isolation, Scope
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.conftest import Workshop
from tests.master.fmi.test_isolation import Faulties, _folder, leftovers, rows
from tests.master.fmus.clocked import clocked

WINE = next((found for name in ("wine64", "/usr/lib/wine/wine64", "wine") if (found := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes of FMUs")
PATIENT = Limits(seconds=60.0)


@pytest.fixture
def connected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Isolated FMUs of Linux are run by the portable program."""
    monkeypatch.setattr(isolated, "run_by_another", lambda fmu: fmu.table is None)
    monkeypatch.setattr(isolated, "runner", lambda: ["env"])
    monkeypatch.setattr(isolated, "portable", lambda _: portable(TARGETS[HOST].zig))


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes are those of systems without shared memory: the master's side is compiled without it, too."""
    functions = loaded(connecting(TARGETS[HOST].zig, "-DPORTABLE"), sharing=False)
    monkeypatch.setattr(child, "_functions", lambda: functions)
    for module in (isolated, isolating, runner):
        monkeypatch.setattr(module, "shares_memory", lambda: False)
    monkeypatch.setattr(isolating, "connecting", lambda _: connecting(TARGETS[HOST].zig, "-DPORTABLE"))


WAYS = pytest.mark.parametrize("way", ["connected", "elsewhere"])


@pytest.fixture
def faulties(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory) -> Faulties:
    return Faulties(workshop, _folder(tmp_path_factory))


def flown(system: Path, out: Path, scope: Scope = "foreign", limits: Limits = PATIENT, **how: Any) -> RunResult:
    return simulate(system, RunOptions(out=out, isolation=Isolation(scope, limits), **how))


def recorded(out: Path) -> Any:
    return pq.read_table(out / "signals.parquet")


@WAYS
def test_the_same_bits_over_a_socket(
    faulties: Faulties, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """Reals, a String, two instances of a file, checkpoints with serialised states; nothing is left behind."""
    (tmp_path / "temporary").mkdir()
    system = faulties.system("none none 0", same_file=True)
    assert flown(system, tmp_path / "shared", checkpoint_every=1.0).outcome == "done"
    request.getfixturevalue(way)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    before = leftovers()
    assert flown(system, tmp_path / "socket", checkpoint_every=1.0).outcome == "done"
    assert leftovers() == before  # and now: threads of pyarrow may keep files open that they have read
    assert recorded(tmp_path / "socket") == recorded(tmp_path / "shared")


@WAYS
def test_clocks_strings_and_binaries(stricts3: Any, tmp_path: Path, request: pytest.FixtureRequest, way: str) -> None:
    clocked(stricts3, "a.fmu", "go", "fire")
    clocked(stricts3, "b.fmu", "go", "fire")
    ports = "text_out:output bytes_out:output ticks_fire:output"
    parts = stricts3.component("a", "a.fmu", ports=f"{ports} fire:output", rule=1, text_in="here")
    parts += stricts3.component("b", "b.fmu", ports=f"{ports} go:input text_in:input bytes_in:input")
    system = stricts3.ssd(parts, "a/fire b/go", "a/text_out b/text_in", "a/bytes_out b/bytes_in")
    assert flown(system, tmp_path / "shared").outcome == "done"
    request.getfixturevalue(way)
    result = flown(system, tmp_path / "socket")
    assert result.outcome == "done", result.error
    assert recorded(tmp_path / "socket") == recorded(tmp_path / "shared")


FAULTS = {
    "segv": r"its process was ended by signal 11 \(SIGSEGV\)",
    "overflow": r"its process was ended by signal 11 \(SIGSEGV\)",
    "abort": r"its process was ended by signal 6 \(SIGABRT\)",
    "exit3": "it has ended its process with exit code 3",
    "kill": "it has ended its process with exit code -9",
    "error": "fmi2Error",
}


@WAYS
@pytest.mark.parametrize("fault", FAULTS)
def test_faults(faulties: Faulties, tmp_path: Path, fault: str, request: pytest.FixtureRequest, way: str) -> None:
    request.getfixturevalue(way)
    result = flown(faulties.system(f"{fault} fmi2DoStep 3"), tmp_path / "out")
    assert result.outcome == "failed"
    assert str(result.error).startswith("bad: fmi2DoStep failed at t = 1 s: ")
    assert re.search(FAULTS[fault], str(result.error)), result.error
    assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]


@WAYS
def test_a_step_that_does_not_return(
    faulties: Faulties, tmp_path: Path, request: pytest.FixtureRequest, way: str
) -> None:
    request.getfixturevalue(way)
    result = flown(faulties.system("sleep fmi2DoStep 3"), tmp_path / "out", limits=Limits(seconds=2.0))
    assert "bad: fmi2DoStep failed at t = 1 s: it did not return within " in str(result.error)
    assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]


@WAYS
def test_a_restart(faulties: Faulties, tmp_path: Path, request: pytest.FixtureRequest, way: str) -> None:
    request.getfixturevalue(way)
    """The recording is that of an FMU that has not crashed."""
    whole = flown(faulties.system("none none 0"), tmp_path / "whole")
    assert whole.outcome == "done"
    result = flown(faulties.system("crash1 fmi2DoStep 3"), tmp_path / "out", limits=Limits(seconds=60.0, restarts=1))
    assert (result.outcome, result.restarts) == ("done", 1), result.error
    assert recorded(tmp_path / "out") == recorded(tmp_path / "whole")


def test_where_memory_is_not_shared_processes_are_asked_for(
    elsewhere: None,
    faulties: Faulties,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without --isolate, FMUs run in the process of the run."""
    isolated._note.cache_clear()  # of tests before
    monkeypatch.setattr(isolating, "DEFAULT", Isolation())
    assert simulate(faulties.system("none none 0"), RunOptions(out=tmp_path / "default")).outcome == "done"
    text = "FMUs run in this process, whose crash would end the run: processes of FMUs have not been tried on Linux"
    assert text in caplog.text
    assert flown(faulties.system("none none 0"), tmp_path / "wanted").outcome == "done"
    assert "the memory, files and sockets of FMUs' processes are not limited on this system" in caplog.text
    assert recorded(tmp_path / "default") == recorded(tmp_path / "wanted")


def test_a_library_that_cannot_be_loaded(connected: None, faulties: Faulties, tmp_path: Path) -> None:
    """The error has the words of the system's loader."""
    system = faulties.system("none none 0")
    spoil(faulties.workshop.root / "bad.fmu", ".so")
    result = flown(system, tmp_path / "out")
    assert re.fullmatch(
        r"\S+: loading \S+bad.fmu failed: \S+\.so: (file too short|invalid ELF header)", str(result.error)
    )


def spoil(fmu: Path, suffix: str) -> None:
    """Replaces the binary of an FMU by a few bytes that are none."""
    with zipfile.ZipFile(fmu) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(fmu, "w") as new:
        for name, content in parts.items():
            new.writestr(name, b"MZ no library" if name.endswith(suffix) else content)


def test_a_runner_that_does_not_connect(
    connected: None, faulties: Faulties, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolated, "runner", lambda: ["false"])
    result = flown(faulties.system("none none 0"), tmp_path / "out")
    assert "its process cannot be started: false has ended with exit code 1" in str(result.error)
    monkeypatch.setattr(isolated, "runner", lambda: ["/nowhere/wine"])
    result = flown(faulties.system("none none 0"), tmp_path / "out2")
    assert "its process cannot be started: No such file or directory" in str(result.error)


def test_the_quotes_of_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "it's")
    with pytest.raises(building.CannotIsolate, match='the quotes of CC="it\'s" do not match'):
        building._compile(tmp_path)


@pytest.mark.parametrize("target", ["x86_64-macos", "aarch64-macos", "aarch64-linux-gnu.2.17"])
def test_it_compiles_for_other_systems(target: str) -> None:
    """Without a warning, on both sides; what it does there is not tested."""
    magic = next(m for name, m in MAGIC.items() if name in target)
    assert portable(target).read_bytes().startswith(magic)
    assert connecting(target, *(["-DPORTABLE"] if "linux" in target else [])).read_bytes().startswith(magic)


MAGIC = {"macos": b"\xcf\xfa\xed\xfe", "linux": b"\x7fELF"}


def test_it_compiles_for_windows(tmp_path: Path) -> None:
    """Without a warning; the test by Wine links it, for which the C library of Windows is compiled for a minute."""
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", *building._PORTABLE, "-c"]
    for name in ("portable", "proxy"):
        source = Path(building.__file__).with_name(f"{name}.c")
        subprocess.run([*compiler, str(source), "-o", str(tmp_path / f"{name}.o")], check=True)
        assert (tmp_path / f"{name}.o").read_bytes()[:2] == b"\x64\x86"  # COFF for x86_64


def windows_fmu(folder: Path, fmi: int) -> tuple[Path, Path]:
    """An FMU of this project for Linux, and one with the Windows binary alone."""
    (model,) = load_models("cosim_models.vehicles.point_mass")
    both = build(model, folder, targets=("linux-x86_64", "windows-x86_64"), fmi=fmi).file
    (folder / "windows").mkdir()
    alone = folder / "windows" / both.name
    with zipfile.ZipFile(both) as old, zipfile.ZipFile(alone, "w") as new:
        for name in old.namelist():
            if "linux" not in name:
                new.writestr(name, old.read(name))
    return both, alone


@pytest.fixture(scope="module")
def of_windows(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return windows_fmu(tmp_path_factory.mktemp("windows"), 2)


def test_without_a_runner_the_error_names_it(of_windows: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RUNNER, raising=False)
    text = "has no library for this platform .*with UAV_COSIM_RUNNER=wine in the environment, Wine runs that of Windows"
    with pytest.raises(SystemDescriptionError, match=text):
        describe(of_windows[1])
    monkeypatch.setenv(RUNNER, "wine64 --of mine")
    found = describe(of_windows[1])
    assert found.library == "binaries/win64/PointMass.dll"
    assert "it has no binary for this platform: that of Windows is run by wine64" in found.notes
    assert describe(of_windows[0]).library == "binaries/linux64/PointMass.so"
    monkeypatch.setenv(RUNNER, "it's wine")
    with pytest.raises(
        SystemDescriptionError, match='variable UAV_COSIM_RUNNER: "it\'s wine" is no command, because its'
    ):
        describe(of_windows[1])


def named(folder: Path, fmu: Path, *attributes: str, of_system: str = "") -> Path:
    """A system with a component of this FMU for each text of attributes of <isolation>; empty without it."""
    made = Workshop(folder)
    shutil.copy(fmu, folder / "point.fmu")
    kind, element = "org.uav-cosim.isolation", '<isolation xmlns="https://uav-cosim.org/ns/1" {}/>'
    parts = "".join(
        made.component(
            f"p{i}",
            "point.fmu",
            "position[1]:output",
            after=made.annotation(kind, element.format(text)) if text else "",
        )
        for i, text in enumerate(attributes)
    )
    after = made.annotation(kind, element.format(of_system)) if of_system else ""
    return made.ssd("named.ssd", made.system(parts, after=after), '<ssd:DefaultExperiment stopTime="0.5"/>')


def test_a_system_names_the_runner(
    of_windows: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script of the user's own, which the user has allowed, gets the program, the port and the library.

    It does not run the program, for which the C library of Windows would be compiled for a minute and a half.
    """
    asked: list[str] = []
    program = portable(TARGETS[HOST].zig)
    monkeypatch.setattr(isolated, "portable", lambda target: asked.append(target) or program)
    script, told = tmp_path / "own runner", tmp_path / "told"
    script.write_text(f'#!/bin/sh\necho "$@" >"{told}"\nexit 7\n')
    script.chmod(0o755)
    monkeypatch.setenv(RUNNER, shlex.join([str(script), "--of", "mine"]))
    given = f"runner={quoteattr(shlex.join([str(script), '--of', 'mine']))}"
    for i, attributes in enumerate((given, f'{given} process="instance"')):
        result = simulate(named(tmp_path, of_windows[1], attributes), RunOptions(out=tmp_path / f"out{i}"))
        assert "own runner has ended with exit code 7" in str(result.error)
        words = told.read_text().split()
        assert words[:3] == ["--of", "mine", str(program)]
        assert words[-1].endswith("PointMass.dll") and words[-2].isdigit()
        told.unlink()
    assert set(asked) == {"x86_64-windows-gnu"}


def test_a_runner_for_a_system_or_a_part(
    of_windows: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The nearest annotation counts; FMUs with a binary for this platform take none; others need one."""
    monkeypatch.delenv(RUNNER, raising=False)
    windows = of_windows[1]
    system = named(tmp_path, windows, "", 'runner="wine" process="instance"', of_system='runner="wine64"')
    checked = check(read_system(system))
    assert [(one.fmu.runner, one.process) for one in checked.instances] == [(("wine64",), ""), (("wine",), "instance")]
    checked = check(read_system(named(tmp_path, of_windows[0], 'runner="wine64"')))
    assert checked.instances[0].fmu.runner == ()
    with pytest.raises(
        SystemDescriptionError, match=r"has no library for this platform.*UAV_COSIM_RUNNER=wine"
    ) as found:
        check(read_system(named(tmp_path, windows, "", 'runner="wine64"')))
    assert len(found.value.problems) == 1 and '"p0"' in str(found.value)


@pytest.mark.parametrize(
    ("attributes", "text"),
    [
        ('runner="rm -r /"', "runner \"rm -r /\" of <isolation> is a command; if you trust it, allow it by "
         "UAV_COSIM_RUNNER='rm -r /' in the environment (without that, a system may name wine or wine64)"),
        ('runner="wine64 other.exe"', 'runner "wine64 other.exe" of <isolation> is a command'),
        ("runner=\"it's\"", 'runner "it\'s" of <isolation> is no command; try wine64'),
        ('runner="wine64" process="here"', 'process "here" of <isolation>: wine64 needs a process of its own'),
        ('runner="wine64" runners="wine"', '<isolation> has no attribute "runners"; valid: "process", "restarts"'),
    ],
)  # fmt: skip
def test_runners_that_are_refused(
    of_windows: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, attributes: str, text: str
) -> None:
    """A system is a document: it does not run commands on the machine of whoever opens it."""
    monkeypatch.delenv(RUNNER, raising=False)
    with pytest.raises(SystemDescriptionError) as found:
        check(read_system(named(tmp_path, of_windows[1], attributes)))
    assert text in str(found.value)


@pytest.fixture(scope="module")
def windows_folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    """That of Wine, which its first start fills."""
    return str(tmp_path_factory.mktemp("prefix"))


@pytest.mark.skipif(WINE is None, reason="Wine is not installed")
def test_an_fmu_of_windows_flies_by_wine(
    of_windows: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, windows_folder: str
) -> None:
    """The point mass computes with sums and products, which are the same everywhere."""
    assert simulate(of_windows[0], RunOptions(out=tmp_path / "linux", until=2.0)).outcome == "done"
    monkeypatch.setenv(RUNNER, str(WINE))
    monkeypatch.setenv("WINEPREFIX", windows_folder)
    monkeypatch.setenv("WINEDEBUG", "-all")
    result = simulate(of_windows[1], RunOptions(out=tmp_path / "windows", until=2.0))
    assert result.outcome == "done", result.error
    tables = [pq.read_table(tmp_path / name / "signals.parquet") for name in ("linux", "windows")]
    assert tables[0].num_rows > 100 and tables[0].equals(tables[1])
    broken = tmp_path / "broken.fmu"
    shutil.copy(of_windows[1], broken)
    spoil(broken, ".dll")
    result = simulate(broken, RunOptions(out=tmp_path / "broken", until=2.0))
    assert re.search(r"PointMass\.dll cannot be loaded: error \d+ of Windows, \w", str(result.error)), result.error


@pytest.mark.skipif(WINE is None, reason="Wine is not installed")
def test_both_sides_run_on_windows(of_windows: tuple[Path, Path], tmp_path: Path, windows_folder: str) -> None:
    """A master of Windows steps a process of Windows, both under Wine; FMPy makes the same calls here."""
    unpacked = {"windows": tmp_path / "windows", "linux": tmp_path / "linux"}
    for name, fmu in zip(unpacked, reversed(of_windows), strict=True):
        fmpy.extract(str(fmu), str(unpacked[name]))
    described = fmpy.read_model_description(str(of_windows[0]))
    master, windows = tmp_path / "master.exe", "x86_64-windows-gnu"
    source = Path(__file__).with_name("master_of_windows.c")
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", windows, "-O1", "-Wall", "-s"]
    subprocess.run([*compiler, str(source), "-o", str(master), "-lws2_32"], check=True)
    library = unpacked["windows"] / "binaries" / "win64" / "PointMass.dll"
    files = [str(connecting(windows)), str(portable(windows)), str(library)]
    environment = {**os.environ, "WINEPREFIX": windows_folder, "WINEDEBUG": "-all"}

    def run(*more: str) -> list[str]:
        command = [str(WINE), str(master), *files, described.guid, *more]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, (done.returncode, done.stdout, done.stderr)
        return done.stdout.splitlines()

    model = fmpy.fmi2.FMU2Slave(
        guid=described.guid,
        unzipDirectory=str(unpacked["linux"]),
        modelIdentifier="PointMass",
        instanceName="mass",
    )
    model.instantiate()
    model.setupExperiment()
    model.enterInitializationMode()
    model.exitInitializationMode()
    wanted = []
    for k in range(20):
        model.setReal([11, 12, 13], [1.0 + k, -0.5 * k, -30.0])
        model.doStep(0.01 * k, 0.01)
        wanted.append(model.getReal([21, 22, 23, 24, 25, 26]))
    model.terminate()
    model.freeInstance()
    assert wanted[-1][0] > 0.01
    assert [list(map(float, line.split())) for line in run()] == wanted
    killed = run("kill")
    assert [list(map(float, line.split())) for line in killed[:10]] == wanted[:10]
    assert killed[10:] == ["status 4 end 6"]  # fatal, the connection is lost
