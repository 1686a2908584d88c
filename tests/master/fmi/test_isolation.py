"""FMUs in processes of their own: the same values as in this process, and faults that end neither run nor recording."""

from __future__ import annotations

import ctypes
import json
import locale
import logging
import os
import re
import shutil
import signal
import sys
import tempfile
import threading
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pythonfmu import FmuBuilder

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.isolating import chosen_isolation, isolation_for
from cosim_master.execution.run.faults.process_state import WatchedSteps
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe, platform
from cosim_master.fmi.isolation.child import Limits
from cosim_master.fmi.slaves.isolated import Isolation, Scope, built_here
from cosim_master.stepping.observation import Progress
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master import processes
from tests.master.conftest import SUFFIX, Workshop, variable
from tests.master.fmus.clocked import clocked
from tests.master.fmus.linear import BALL_PORTS, ball, impacts
from tests.master.fmus.probe import compiled

LIMITS = Limits(seconds=1.0, memory=64 << 20)
PATIENT = Limits(memory=64 << 20)
ABLE = (
    'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true" canSerializeFMUstate="true" '
    'canNotUseMemoryManagementFunctions="true"'
)
Run = Callable[..., RunResult]
SOURCE = Path(__file__).parents[1] / "fmus" / "faulty.c"


class Faulties:
    """Systems of faulty FMUs (see faulty.c): `bad` and `good`, each of a file of its own."""

    def __init__(self, workshop: Workshop, folder: Path) -> None:
        self.workshop, self._folder = workshop, folder

    def fmu(self, name: str, guid: str, flags: str = ABLE, source: Path = SOURCE, *more: str) -> bytes:
        """Writes an FMU, and returns its library."""
        variables = [variable("u"), variable("y", "output"), variable("s", "output", kind="String")]
        variables[2] = variables[2].replace("'@'", '"0"')
        text = self.workshop.description(variables, step=0.5, flags=flags).replace('guid="{0}"', f'guid="{guid}"')
        with zipfile.ZipFile(self.workshop.root / name, "w") as archive:
            archive.writestr("modelDescription.xml", text)
            library = compiled(source, self._folder, *more)
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)
        return library

    def system(self, fault: str, *, same_file: bool = False, names: tuple[str, str] = ("bad", "good")) -> Path:
        self.fmu("bad.fmu", fault)
        self.fmu("good.fmu", "none none 0")
        files = ("bad.fmu", "bad.fmu" if same_file else "good.fmu")
        parts = "".join(
            self.workshop.component(name, file, "u:input y:output s:output:String")
            for name, file in zip(names, files, strict=True)
        )
        wires = self.workshop.connection(f"{names[1]}/y", f"{names[0]}/u")
        system = self.workshop.system(parts, wires)
        experiment = '<ssd:DefaultExperiment startTime="0" stopTime="2"/>'
        return self.workshop.ssd("system.ssd", system, experiment)


@pytest.fixture
def faulties(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory) -> Faulties:
    return Faulties(workshop, _folder(tmp_path_factory))


_FOLDER: list[Path] = []


def _folder(factory: pytest.TempPathFactory) -> Path:
    """One folder for the session, so that the library is compiled once."""
    if not _FOLDER:
        _FOLDER.append(factory.mktemp("faulty"))
    return _FOLDER[0]


@pytest.fixture
def run(faulties: Faulties, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))

    def runs(fault: str, scope: Scope = "foreign", limits: Limits = PATIENT, **how: Any) -> RunResult:
        options = RunOptions(out=tmp_path / "out", isolation=Isolation(scope, limits))
        return simulate(faulties.system(fault, **how), options)

    return runs


def rows(folder: Path) -> list[float]:
    return list(pq.read_table(folder / "signals.parquet")["time"].to_pylist())


FAULTS = {
    "segv": r"its process was ended by signal 11 \(SIGSEGV\)",
    "abort": r"its process was ended by signal 6 \(SIGABRT\)",
    "overflow": r"its process was ended by signal 11 \(SIGSEGV\)",
    "alarm": r"its process was ended by signal 14 \(SIGALRM\)",
    "divide": r"its process was ended by signal 8 \(SIGFPE\)",
    "kill": r"its process was ended by signal 9 \(SIGKILL\)",
    "exit": "it has ended its process with exit code 0",
    "exit3": "it has ended its process with exit code 3",
    "hang": "it did not return within 1 s, and its process was killed",
    "sleep": "it did not return within 1 s, and its process was killed",
    "memory": r"its process was ended by signal 11 \(SIGSEGV\), with [56]\d of 64 MiB of memory in use",
}


def descriptors() -> set[str]:
    return {path.name for path in Path("/proc/self/fd").iterdir()}


def leftovers() -> set[str]:
    """What a run must leave as it was: processes, descriptors, temporary folders."""
    return {*processes.children(os.getpid()), *descriptors(), *map(str, Path(tempfile.gettempdir()).iterdir())}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_step_that_does_not_return(run: Run, tmp_path: Path, fault: str) -> None:
    """The third step fails: recording and manifest are complete up to its start, and nothing is left over."""
    before = leftovers()
    # Only what hangs has little time: the others must fail by themselves, also where the machine is busy.
    result = run(f"{fault} fmi2DoStep 3", limits=LIMITS if fault in ("hang", "sleep") else PATIENT)
    assert leftovers() <= before
    text = str(result.error)
    assert (result.outcome, result.simulated_s) == ("failed", 1.0)
    assert text.startswith("bad: fmi2DoStep failed at t = 1 s: ")
    assert re.search(FAULTS[fault] + "; its inputs: u = 1", text), text
    assert "a step of 0.5 s from t = 1 s" in text  # the arguments of its log are formatted
    assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["simulated_s"], manifest["error"]) == ("failed", 1.0, text)


FUNCTIONS = {
    "fmi2Instantiate 1": "bad: fmi2Instantiate failed: ",
    "fmi2SetupExperiment 1": "bad: fmi2SetupExperiment failed at t = 0 s: ",
    "fmi2EnterInitializationMode 1": "bad: fmi2EnterInitializationMode failed at t = 0 s: ",
    "fmi2ExitInitializationMode 1": "bad: fmi2ExitInitializationMode failed at t = 0 s: ",
    "fmi2GetReal 1": "bad: fmi2GetReal failed at t = 0 s: ",
    "fmi2GetString 2": "bad: fmi2GetString failed at t = 0.5 s: ",
    "fmi2SetReal 5": "bad: fmi2SetReal failed at t = 1 s: ",
    "fmi2Terminate 1": "bad: fmi2Terminate failed at t = 2 s: ",
    "fmi2FreeInstance 1": "bad: fmi2FreeInstance failed at t = 2 s: ",
}


HANGING = ("fmi2EnterInitializationMode 1", "fmi2SetReal 5", "fmi2GetString 2", "fmi2FreeInstance 1")


@pytest.mark.parametrize(
    ("fault", "place"),
    [*((fault, place) for fault in ("segv", "exit") for place in FUNCTIONS), *(("sleep", one) for one in HANGING)],
)
def test_any_function_that_does_not_return(run: Run, fault: str, place: str) -> None:
    before = leftovers()
    result = run(f"{fault} {place}", limits=LIMITS if fault == "sleep" else PATIENT)
    assert leftovers() <= before
    assert result.outcome == "failed"
    assert str(result.error).startswith(FUNCTIONS[place]), str(result.error)
    assert re.search(FAULTS[fault].replace("1 s", r"(1|6) s"), str(result.error)), str(result.error)


def test_an_error_of_a_deferred_set_is_that_of_the_set(run: Run, tmp_path: Path) -> None:
    """It travels with the step; a set that is discarded is not a step that is discarded."""
    for status in ("error", "discard"):
        result = run(f"{status} fmi2SetReal 5")
        assert str(result.error).startswith("bad: fmi2SetReal failed at t = 1 s: fmi2Error; its inputs: u = 1")
        assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]


def test_instances_of_a_file_share_a_process_or_not(run: Run, tmp_path: Path) -> None:
    """By default the crash of one ends both: one is blamed. With a process each, the other one is terminated."""
    shared = run("segv fmi2DoStep 3", same_file=True)
    assert str(shared.error).startswith("bad: fmi2DoStep failed at t = 1 s: its process was ended by signal 11")
    each = run("segv fmi2Terminate 1", "instance", same_file=True)
    assert (each.outcome, each.simulated_s) == ("failed", 2.0)
    assert str(each.error).startswith("bad: fmi2Terminate failed at t = 2 s: its process was ended by signal 11")


def test_processes_step_at_the_same_time(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each step of the two waits until the other one has begun, which it has not if they step in turn."""
    monkeypatch.setenv("FAULTY_FILE", str(tmp_path / "met"))
    limits = replace(PATIENT, restricted=False)
    result = run("meet fmi2DoStep 2", "instance", limits, same_file=True, names=("bad1", "bad2"))
    assert (result.outcome, result.simulated_s) == ("done", 2.0)


def test_one_of_many_in_a_process_fails(run: Run, tmp_path: Path) -> None:
    """All step in one round trip: an error or a crash is that of one, and those before it have made the step."""
    text = str(run("error fmi2DoStep 3", same_file=True, names=("bad", "good")).error)
    assert text.startswith("bad: fmi2DoStep failed at t = 1 s: fmi2Error") and "good" not in text
    text = str(run("segv fmi2DoStep 3", same_file=True, names=("alone", "bad")).error)
    assert text.startswith("bad: fmi2DoStep failed at t = 1 s: its process was ended by signal 11")
    assert "alone:" not in text
    assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]


def test_a_library_that_does_not_ask_for_libm(faulties: Faulties, tmp_path: Path) -> None:
    """As FMUs of Overture: Python and Java have loaded libm, and so must have the process of an FMU."""
    source = tmp_path / "unlinked.c"
    source.write_text(
        '#include "faulty.c"\ndouble sinh(double);\nEXPORT double unlinked(double x) { return sinh(x); }\n'
    )
    library = faulties.fmu("one.fmu", "none none 0", ABLE, source, "-nostdlib", "-target", "native")
    assert b"sinh" in library and b"libm.so" not in library
    system = faulties.workshop.system(faulties.workshop.component("a", "one.fmu"))
    path = faulties.workshop.ssd("one.ssd", system, '<ssd:DefaultExperiment startTime="0" stopTime="2"/>')
    result = simulate(path, RunOptions(isolation=Isolation("foreign", PATIENT)))
    assert result.outcome == "done", result.error


@pytest.mark.parametrize("scope", ["foreign", "instance"])
def test_the_same_bits(run: Run, tmp_path: Path, scope: Scope) -> None:
    results = []
    for isolated in ("none", scope):
        assert run("none none 0", isolated, same_file=True).outcome == "done"
        results.append(pq.read_table(tmp_path / "out" / "signals.parquet"))
    assert results[0].equals(results[1])
    assert results[0]["bad.s"].to_pylist() == ["0 steps", "1 steps", "2 steps", "3 steps", "4 steps"]


def test_what_an_fmu_prints_is_part_of_its_log(run: Run, capfd: pytest.CaptureFixture[str]) -> None:
    """Not of this program's output, which may be a JSON document."""
    result = run("print fmi2DoStep 1")
    assert result.outcome == "done"
    assert capfd.readouterr() == ("", "")


def test_what_it_prints_does_not_command_the_terminal(run: Run) -> None:
    """The FMU prints an escape sequence, and crashes later."""
    text = str(run("print-and-segv fmi2DoStep 3").error)
    assert "    printed by the FMU\n    \\x1b[31mred" in text and "\x1b" not in text


def test_an_fmu_that_changes_its_process(run: Run) -> None:
    """Closed descriptors, working directory, locale, signals and umask are its own."""

    def state() -> tuple[Any, ...]:
        os.umask(mask := os.umask(0o22))
        return Path.cwd(), mask, signal.getsignal(signal.SIGINT), descriptors()

    before = state()
    assert run("scribble fmi2DoStep 1").outcome == "done"
    assert state() == before


@pytest.mark.parametrize("scope", ["none", "foreign"])
def test_names_never_meet_the_file_system(run: Run, tmp_path: Path, scope: Scope) -> None:
    """Components with the names of folders above, or with names too long for a file, are recorded as others."""
    names = ("bad/../../../x", "\N{GRINNING FACE}" * 200)
    result = run("none none 0", scope, names=names)
    assert result.outcome == "done", result.error
    assert f"{names[1]}.y" in pq.read_table(tmp_path / "out" / "signals.parquet").column_names
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["manifest.json", "signals.parquet"]
    assert not (tmp_path / "x").exists()


CHANGES = {
    "chdir": r"the working directory \(now /\)",
    "locale": r"the locale \(now .*\)",
    "handler": "the handling of SIGALRM",
    "rounding": "the rounding mode of floating-point numbers",
    "umask": r"the permissions of new files \(umask 000\)",
    "close": r"open files: descriptors \d+ \(.*/kept\) were closed",
}


@pytest.fixture
def restored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Restores what an FMU changes in this process, and opens a file that it may close."""
    folder, language = Path.cwd(), locale.setlocale(locale.LC_ALL)
    os.umask(mask := os.umask(0o22))
    kept = os.open(tmp_path / "kept", os.O_CREAT | os.O_WRONLY)
    monkeypatch.setenv("FAULTY_FILE", str(kept))
    yield
    os.chdir(folder)
    locale.setlocale(locale.LC_ALL, language)
    os.umask(mask)
    signal.signal(signal.SIGALRM, signal.getsignal(signal.SIGALRM) or signal.SIG_DFL)
    ctypes.CDLL("libm.so.6").fesetround(0)
    with suppress(OSError):
        os.close(kept)


@pytest.mark.usefixtures("restored")
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("function", ["fmi2Instantiate", "fmi2EnterInitializationMode", "fmi2DoStep"])
def test_an_fmu_that_changes_the_process_of_the_run(run: Run, tmp_path: Path, change: str, function: str) -> None:
    """In this process, that is noted, with the function if Python calls it; in another one, it has no effect."""
    result = run(f"{change} {function} 1", "none", names=("bad", "good"))
    where = f"bad has .* in {function}"
    if function == "fmi2DoStep":
        where = "one of bad, good has .* in a step between t = 0 s and t = [.0-9]+ s"
    notes = [note for note in result.notes if "has changed the process of the run" in note]
    assert len(notes) == 1 and re.search(f"^{where}.*: {CHANGES[change]}", notes[0]), notes
    assert notes[0] in json.loads((tmp_path / "out" / "manifest.json").read_text())["notes"]


@pytest.mark.usefixtures("restored")
def test_changes_in_steps_are_found_with_their_time(
    faulties: Faulties, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is told once, with the comparisons before and after it; files that others open and close are no changes."""
    monkeypatch.setattr("cosim_master.execution.run.faults.process_state._INTERVAL", 0.0)
    (tmp_path / "here").mkdir()
    found: list[WatchedSteps] = []
    original = WatchedSteps.progressed

    def progressed(self: WatchedSteps, progress: Progress) -> None:
        found.append(self)
        original(self, progress)

    monkeypatch.setattr(WatchedSteps, "progressed", progressed)
    faulties.fmu("bad.fmu", "none none 0")
    path = faulties.workshop.ssd("one.ssd", faulties.workshop.system(faulties.workshop.component("bad", "bad.fmu")))
    result = simulate(path, RunOptions(until=1.0, isolation=Isolation("none")))
    assert not any("changed the process" in note for note in result.notes)
    steps = found[0]  # of a run that has ended
    wall = iter(range(1, 10))

    def until(time: float) -> None:
        steps.progressed(Progress(time, 0.0, 9.0, float(next(wall)), {"sent": 0}))

    ended = threading.Event()
    steps.begin(0.0, ended.is_set)
    until(1.0)
    os.chdir(tmp_path / "here")
    opened = (tmp_path / "file").open("w")
    until(2.5)
    opened.close()
    until(3.0)
    os.umask(0o27)
    until(4.0)
    signal.signal(signal.SIGALRM, lambda *_: None)
    ended.set()
    until(5.0)  # the run is interrupted, which has changed signal handlers itself
    text = "(doStep, or a function that sets or gets values)"
    assert [note.partition("process of the run in ")[2].partition(" (--isolate")[0] for note in steps.notes] == [
        f"a step between t = 1 s and t = 2.5 s {text}: the working directory (now {tmp_path / 'here'})",
        f"a step between t = 3 s and t = 4 s {text}: the permissions of new files (umask 027)",
    ]
    assert all(note.startswith("bad has changed the") for note in steps.notes)


def test_it_writes_into_its_folder_only(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the kernel has Landlock and seccomp, as here; unrestricted, it may do what this process may."""
    monkeypatch.setenv("FAULTY_FILE", str(tmp_path / "outside.txt"))
    text = str(run("write fmi2DoStep 1").error)
    assert [line for line in ("open: refused", "own: done", "socket: refused") if line not in text] == []
    assert not (tmp_path / "outside.txt").exists()
    text = str(run("write fmi2DoStep 1", limits=replace(PATIENT, restricted=False)).error)
    assert "open: done" in text and "socket: done" in text
    assert (tmp_path / "outside.txt").exists()


def test_a_kernel_without_landlock(run: Run, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """A note says so once, and the run goes on."""
    monkeypatch.setattr("cosim_master.fmi.isolation.child._RESTRICTED_FILES", 4)  # a bit that no kernel sets
    assert run("none none 0").outcome == "done"
    text = "note: this kernel cannot forbid FMUs to write outside of their folders"
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == [text]


def test_checkpoints_of_isolated_fmus(faulties: Faulties, tmp_path: Path) -> None:
    """States are saved and serialised in the process; a run goes on from them isolated or not, with the same bits."""
    system = faulties.system("none none 0")
    isolated = Isolation("foreign", PATIENT)
    whole, again = tmp_path / "whole", tmp_path / "again"
    assert simulate(system, RunOptions(out=whole, checkpoint_every=1.0, isolation=isolated)).outcome == "done"
    for isolation in (isolated, Isolation("none")):
        result = simulate(system, RunOptions(out=again, origin=f"{whole}@1", isolation=isolation))
        assert result.outcome == "done"
        assert pq.read_table(again / "signals.parquet").equals(pq.read_table(whole / "signals.parquet"))


def test_the_system_sets_the_process_of_an_instance(faulties: Faulties) -> None:
    """The nearest annotation counts, unless the run wants another scope than the default."""
    faulties.fmu("bad.fmu", "none none 0")

    def part(name: str, process: str = "") -> str:
        inner = f'<isolation xmlns="https://uav-cosim.org/ns/1" process="{process}"/>'
        after = faulties.workshop.annotation("org.uav-cosim.isolation", inner) if process else ""
        return faulties.workshop.component(name, "bad.fmu", after=after)

    parts = part("a") + part("b", "here") + part("c", "instance") + part("d", "file")
    checked = check(read_system(faulties.workshop.ssd("s.ssd", faulties.workshop.system(parts))))
    chosen = isolation_for(Isolation("foreign"), checked)
    fmu = checked.instances[0].fmu
    assert [(chosen.isolates(fmu, x), chosen.each(fmu, x)) for x in "abcd"] == [
        (True, False), (False, False), (True, True), (True, False),
    ]  # fmt: skip
    assert not any(isolation_for(Isolation("none"), checked).isolates(fmu, x) for x in "abcd")
    with pytest.raises(SystemDescriptionError, match='process "there" of <isolation>; valid: here, file, instance'):
        check(read_system(faulties.workshop.ssd("s.ssd", faulties.workshop.system(part("a", "there")))))


def test_a_limit_of_memory_that_limits_nothing_is_noted(faulties: Faulties, caplog: pytest.LogCaptureFixture) -> None:
    checked = check(read_system(faulties.system("none none 0")))
    with caplog.at_level(logging.WARNING):
        for chosen in (chosen_isolation("none", None, None), chosen_isolation("all", None, 64)):
            isolation_for(chosen, checked)
        assert caplog.text == ""
        isolation_for(chosen_isolation("none", None, 64), checked)
    said = "note: --memory-limit limits nothing: no FMU of this system runs in a process of its own; --isolate all"
    assert said in caplog.text


def test_our_fmus_are_not_isolated(fmus: Path, faulties: Faulties) -> None:
    """An FMU that only says that this project has built it is a foreign one."""
    ours = describe(fmus / "Quadrotor.fmu")
    assert built_here(ours) and not Isolation("foreign").isolates(ours) and Isolation("all").isolates(ours)
    faulties.fmu("bad.fmu", "none none 0")
    theirs = describe(faulties.workshop.root / "bad.fmu")
    assert Isolation("foreign").isolates(theirs) and not Isolation("none").isolates(theirs)
    assert Isolation("foreign").isolates(replace(theirs, generation_tool="uav-cosim"))
    assert not built_here(replace(ours, guid=ours.guid.upper()))


def test_a_swarm_opens_each_file_once(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if another file has taken the place of one that was asked for."""
    opened: list[Path] = []
    whole = zipfile.ZipFile

    def counted(file: Path, *more: Any) -> zipfile.ZipFile:
        opened.append(file)
        return whole(file, *more)

    copy = tmp_path / "Copy.fmu"
    shutil.copy(fmus / "Quadrotor.fmu", copy)
    ours = describe(copy)
    monkeypatch.setattr("cosim_master.fmi.slaves.isolated.zipfile.ZipFile", counted)
    assert all(not Isolation("foreign").isolates(ours, f"drone{i}") for i in range(100))
    assert opened == [copy]
    copy.write_bytes(b"nothing")
    assert Isolation("foreign").isolates(replace(ours, digest="of another file"))


def test_options() -> None:
    assert chosen_isolation(None, None, None) is None
    assert chosen_isolation("instance", 2.0, 64) == Isolation("instance", Limits(2.0, 64 << 20))
    with pytest.raises(SystemDescriptionError, match='"file" is not one of none, foreign, instance, all'):
        chosen_isolation("file", None, None)


def recordings(system: Path, folder: Path, **options: Any) -> list[Any]:
    """What a run records in this process, and with foreign FMUs in processes of their own."""
    made = []
    for isolation in (Isolation("none"), Isolation("foreign")):
        result = simulate(system, RunOptions(out=folder / isolation.scope, isolation=isolation, **options))
        assert result.outcome == "done", result.error
        made.append(pq.read_table(folder / isolation.scope / "signals.parquet"))
    return made


def test_events_of_fmi_3(linears: Any, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The ball announces some of its events and returns early for others."""
    ball(linears.workshop, tmp_path_factory.getbasetemp())
    parts = linears.workshop.component("ball", "ball.fmu", BALL_PORTS)
    here, there = recordings(linears.ssd(parts, stop=2.0), tmp_path, step=0.01)
    assert here.equals(there)
    assert there["ball.bounces"].to_pylist()[-1] == sum(time <= 2.0 for time in impacts(30))


def test_clocks_strings_and_binaries(stricts3: Any, tmp_path: Path) -> None:
    clocked(stricts3, "a.fmu", "constant", "countdown", "fire", period=0.25)
    clocked(stricts3, "b.fmu", "go", "fire")
    ports = "text_out:output bytes_out:output ticks_fire:output"
    parts = stricts3.component("a", "a.fmu", ports=f"{ports} fire:output", rule=1, text_in="here")
    parts += stricts3.component("b", "b.fmu", ports=f"{ports} go:input text_in:input bytes_in:input")
    wires = ("a/fire b/go", "a/text_out b/text_in", "a/bytes_out b/bytes_in")
    here, there = recordings(stricts3.ssd(parts, *wires, stop=1.0), tmp_path)
    assert here.equals(there) and stricts3.complaints == []
    assert there["b.text_out"].to_pylist() == ["here"] * 3


@pytest.mark.parametrize("fmi", [2, 3])
def test_model_exchange(dynamics: Any, tmp_path: Path, fmi: int) -> None:
    """The solver runs here and evaluates the FMU there, also its directional derivatives."""
    here, there = recordings(dynamics.fmu("VANDERPOL", fmi, stop=2.0, step=0.5), tmp_path)
    assert here.equals(there) and here.num_rows == 5


SLAVE = """
import os, own_module
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        print("printed at", t)
        self.y = own_module.VALUE
        if t == 1.0:
            {fault}
        return True
"""


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("pass", ""),
        ("os._exit(3)", "exit code 3"),
        ("raise ValueError('no way')", "no way"),
        ("open(os.path.expanduser('~/written'), 'w')", "Permission denied"),
    ],
)
def test_python_fmus(workshop: Workshop, tmp_path: Path, fault: str, text: str) -> None:
    """Each has an interpreter of its own: modules of one name do not meet, and what it prints is its log."""
    parts = ""
    for n, name in enumerate(("Bad", "Good")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "own_module.py").write_text(f"VALUE = {n + 1}.0\n")
        source = SLAVE.format(name=name, fault=fault if name == "Bad" else "pass")
        (folder / f"{name.lower()}_slave.py").write_text(source)
        made = FmuBuilder.build_FMU(
            folder / f"{name.lower()}_slave.py", dest=folder, project_files=[folder / "own_module.py"]
        )
        (workshop.root / f"{name}.fmu").write_bytes(Path(made).read_bytes())
        sys.modules.pop("own_module", None)
        parts += workshop.component(name, f"{name}.fmu", "y:output")
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="2"/>'
    system = workshop.ssd("python.ssd", workshop.system(parts), experiment)
    result = simulate(system, RunOptions(out=tmp_path / "out", step=0.5, isolation=Isolation("foreign")))
    got = pq.read_table(tmp_path / "out" / "signals.parquet")
    assert (got["Bad.y"].to_pylist()[1], got["Good.y"].to_pylist()[1]) == (1.0, 2.0)
    if not text:
        assert result.outcome == "done"
        return
    assert (result.outcome, got["time"].to_pylist()) == ("failed", [0.0, 0.5, 1.0])
    assert str(result.error).startswith("Bad: fmi2DoStep failed at t = 1 s: ") and text in str(result.error)
