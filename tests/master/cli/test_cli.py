"""The command: exit codes, messages, and what it passes on. Most through typer's runner, once as a process."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim.build import models_of_package
from cosim_master.campaigns.dataset.folder import Folder
from cosim_master.campaigns.study.study import Study
from cosim_master.cli import app, err, out
from cosim_master.cli.terminal import progress
from cosim_master.cli.verbs import run as verb_run
from cosim_master.execution.outcome.result import Outcome, RunResult
from tests.master.fmus.probe import model
from tests.master.forks import TO_ITS_END, Forks
from tests.master.full_disk import room_of

pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Calls the command in tmp_path: (exit code, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)
    # Consoles look up sys.stdout at every print, so the runner's own streams are used; their width is that of a file.
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(progress, "LONG", 1000.0)  # a busy machine says no more than another; see test_terminal.py
    assert out.file is not sys.stdout or not out.is_terminal
    assert not err.is_terminal

    def call(*arguments: str) -> tuple[int, str, str]:
        result = CliRunner().invoke(app, arguments)
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result.exit_code, result.stdout, result.stderr

    return call


@pytest.fixture
def system(probes: Any) -> Path:
    probes.fmu()
    made: Path = probes.ssd(probes.component("a", u=1.0) + probes.component("b"), "a/y b/u")
    return made


def test_run(run: Any, system: Path, tmp_path: Path) -> None:
    code, stdout, stderr = run("run", str(system), "-o", "results")
    assert code == 0, stderr
    pattern = r"done: 2 s simulated in \d+\.\d\d s \(\d+\.\d times real time\)\n"
    assert re.fullmatch(pattern + r"packets: 0 sent, 0 delivered, 0 lost\nresults: results\n", stdout)
    proposed = "note: probe.fmu: it steps by 0.5 s, which the FMU proposes (DefaultExperiment); --step gives another"
    assert "note: " not in stderr.replace("note: the system names no", "").replace(proposed, "")
    assert json.loads((tmp_path / "results" / "manifest.json").read_text())["outcome"] == "done"


def test_quiet_leaves_out_findings_that_are_notes(run: Any, system: Path) -> None:
    code, stdout, stderr = run("run", str(system), "-o", "results")
    assert code == 0 and re.search(r"^note +open input +nothing drives a\.n, b\.n", stderr, re.MULTILINE), stderr
    assert re.search(r"^finding +time \[s\] +about *$", stderr, re.MULTILINE), stderr
    assert stdout.startswith("done: 2 s simulated"), "notes are not counted"
    assert run("-q", "run", str(system), "-o", "results") == (0, "", "")
    assert run("check", str(system), "-q") == (0, "", "")


def test_results_go_to_out_by_default(run: Any, system: Path, tmp_path: Path) -> None:
    assert run("run", str(system))[0] == 0
    assert (tmp_path / "out" / "s" / "manifest.json").is_file()


def test_results_of_other_inputs_are_not_overwritten(run: Any, system: Path, tmp_path: Path) -> None:
    def rows(folder: str) -> int:
        return int(pq.read_table(tmp_path / folder / "signals.parquet").num_rows)

    assert run("run", str(system))[1].endswith("results: out/s\n")
    assert run("run", str(system))[1].endswith("results: out/s\n"), "the same inputs"
    code, stdout, stderr = run("run", str(system), "--until", "1")
    assert code == 0 and stdout.endswith("results: out/s-2\n")
    assert "note: out/s holds a run of other inputs, which --force overwrites; the results are in out/s-2\n" in stderr
    assert (rows("out/s"), rows("out/s-2")) == (5, 3)
    code, stdout, stderr = run("run", str(system), "--until", "1", "-o", "out/s")
    assert (code, stdout, rows("out/s")) == (2, "", 5)
    assert "error: out/s: holds the results of a run with other inputs (time); give another folder, or " in stderr
    assert run("run", str(system), "--until", "1", "-o", "out/s", "--force")[0] == 0
    assert rows("out/s") == 3


def test_a_run_is_not_written_into_a_campaign(run: Any, system: Path, tmp_path: Path) -> None:
    (tmp_path / "out" / "s").mkdir(parents=True)
    (tmp_path / "out" / "s" / "study.json").write_text("{}")
    code, _, stderr = run("run", str(system), "-o", "out/s", "--force")
    assert code == 2
    assert "error: out/s: holds a campaign; give another folder" in stderr.splitlines()
    code, stdout, stderr = run("run", str(system))
    assert code == 0 and stdout.endswith("results: out/s-2\n")
    assert "note: out/s holds a campaign; the results are in out/s-2" in stderr.splitlines()
    assert [file.name for file in (tmp_path / "out" / "s").iterdir()] == ["study.json"]


def test_options_of_run(run: Any, system: Path, tmp_path: Path) -> None:
    arguments = (
        "--until",
        "1",
        "--set",
        "a.p=10",
        "--set",
        "b.mode = 1",
        "--record",
        "b.y",
        "--seed",
        "5",
        "--pace",
        "1000",
    )
    code, _, stderr = run("run", str(system), "-o", "out", *arguments)
    assert code == 0, stderr
    assert pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict() == {
        "time": [0.0, 0.5, 1.0],
        "b.y": [11.25, 11.25, 11.25],
    }
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["seed"] == 5
    assert manifest["instances"]["b"]["parameters"]["mode"] == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "a.p"), "error: --set a.p: write COMPONENT.PARAMETER=VALUE"),
        (("--set", "=3"), "error: --set =3: write COMPONENT.PARAMETER=VALUE"),
        (("--set", "a.q=1"), 'error: --set: there is no variable "a.q"'),
        (("--set", "c.p=1"), 'error: --set: there is no variable "c.p"'),
        (("--set", "a.p=much"), 'error: --set: a.p: "much" is not of its type; valid: a number'),
        (("--set", "a.p=1_5"), 'error: --set: a.p: "1_5" is not of its type; valid: a number'),
        (("--set", "a.mode=1_0"), 'error: --set: a.mode: "1_0" is not of its type; valid: an integer'),
        (("--set", "a.mode=1.5"), 'error: --set: a.mode: "1.5" is not of its type; valid: an integer'),
        (("--until", "1.3"), "a run of 1.3 s is not a multiple of the base step 0.5 s; try --until 1.5"),
        (("--until", "soon"), "Invalid value for '--until'"),
        (("--until", "nan"), "error: --until nan: give a stop time in s, a positive number"),
        (("--until", "0"), "error: --until 0: give a stop time in s, a positive number"),
        (("--until", "-3"), "error: --until -3: give a stop time in s, a positive number"),
        (("--step", "-0.1"), "error: --step -0.1: give a step size in s, a positive number"),
        (("--step", "0"), "error: --step 0: give a step size in s, a positive number"),
        (("--pace", "0"), "error: --pace 0: give a factor of real time, a positive number"),
        (("--pace", "-1"), "error: --pace -1: give a factor of real time, a positive number"),
        (("--pace", "inf"), "error: --pace inf: give a factor of real time, a positive number"),
        (("--checkpoint-every", "0"), "error: --checkpoint-every 0: give an interval in simulated s, a positive"),
        (("--checkpoint-every", "-2"), "error: --checkpoint-every -2: give an interval in simulated s, a positive num"),
        (("--threads", "0"), "error: --threads 0: give a positive number"),
        (("--ros1", "http://localhost:many"), "error: --ros1 http://localhost:many: give the address of its master"),
        (("--ros1", "http://localhost"), "error: --ros1 http://localhost: give the address of its master"),
        (("--ros1", "foo"), "error: --ros1 foo: give the address of its master, such as http://127.0.0.1:11311"),
        (("--seed", "-1"), "Invalid value for '--seed'"),
        (("--seed", str(2**60)), "Invalid value for '--seed'"),
        (("--record", "c.*"), 'error: --record: "c.*" matches no output or local variable; valid: "a.c"'),
        (("-o", "s.ssd"), "error: s.ssd: cannot hold the results of a run: "),
        (("--partition-timeout", "3"), "error: --partition-timeout belongs to --partitions, which is not given"),
        (("--unknown",), "No such option"),
    ],
)
def test_bad_usage_has_exit_code_2(
    run: Any, system: Path, probes: Any, arguments: tuple[str, ...], message: str
) -> None:
    code, stdout, stderr = run("run", str(system), *arguments)
    assert code == 2
    assert message in stderr
    assert stdout == ""
    assert probes.calls == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("check", "probe.fmu", "--tolerance", "0.1"), "error: --tolerance belongs to --reference, which is not given"),
        (("check", "probe.fmu", "--reference", "r.csv", "--tolerance", "-1"), "Invalid value for '--tolerance'"),
        (("report", "results", "-o", "a/r.txt"), "error: -o a/r.txt: a report is an HTML page; name it a/r.html"),
        (
            ("sweep", "line5", "--vary", "a.p=1,2", "--trials", "5"),
            "error: --trials belongs to --optimise, which is not",
        ),
        (("new", "line", "--drones", "5", "--seed", "2", "-o", "x"), "error: --seed belongs to --layout random, which"),
        (
            ("new", "line", "--layout", "ring", "--drones", "5", "--seed", "2", "-o", "x"),
            "error: --seed belongs to --l",
        ),
        (("new", "line5", "--layout", "s.ssd", "--spacing", "5", "-o", "x"), "error: --spacing: s.ssd has the positio"),
        (("export", "results", "-o", "x.csv", "--origin", "1,2,3"), "error: export: --origin belongs to --mcap, --fox"),
        (
            ("export", "results", "--kml", "x.kml", "--numbers"),
            "error: export: --numbers belongs to --csv; none of the",
        ),
    ],
)
def test_options_that_do_not_fit(run: Any, system: Path, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    assert system == tmp_path / "s.ssd"
    before = {*tmp_path.iterdir()}
    code, stdout, stderr = run(*words)
    assert code == 2
    assert message in stderr
    assert stdout == ""
    assert {*tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    "words",
    [
        "--until 5",
        "--step 0.1",
        "--solver euler",
        "--variant v",
        "--trials 5",
        "--seeds 3",
        "--sample lhs:3",
        "--set a=1",
    ],
)
def test_a_campaign_goes_on_without_options_of_its_study(run: Any, tmp_path: Path, words: str) -> None:
    with Folder(tmp_path / "study", Study(system="line5"), {}):
        pass
    text = "error: study holds a campaign, which goes on as it began; leave out all options of the study\n"
    assert run("sweep", "study", *words.split()) == (2, "", text)


def test_a_value_for_a_connected_input_is_noted(run: Any, system: Path) -> None:
    """It is legal, and the guess with which a loop begins; but what it sets is overwritten."""
    _, _, stderr = run("run", str(system), "--set", "b.u=7", "--set", "a.p=2")
    found = [line for line in stderr.splitlines() if "before the first step only" in line]
    assert found == ["note: --set b.u=7.0 holds before the first step only: the input is connected"]


def test_malformed_packets_are_counted_on_the_last_lines(capsys: pytest.CaptureFixture[str]) -> None:
    counts = {"sent": 5, "delivered": 4, "lost": 1}
    for more, text in (({}, ""), ({"malformed": 2}, ", 2 malformed")):
        verb_run._report(RunResult(Outcome.DONE, None, packets={**counts, **more}))
        assert f"packets: 5 sent, 4 delivered, 1 lost{text}\n" in capsys.readouterr().out


def test_patterns_of_signals_are_refused_where_they_are_written(run: Any, system: Path) -> None:
    text = 'error: --set recording.signals: "c.*" matches no output or local variable; valid: "a.c"'
    assert text in run("run", str(system), "--set", "recording.signals=c.*")[2]
    written = '<ssd:Annotations><ssc:Annotation type="org.uav-cosim.recording"><recording signals="c.*" '
    written += 'xmlns="https://uav-cosim.org/ns/1"/></ssc:Annotation></ssd:Annotations>'
    content = system.read_text()
    system.write_text(content.replace("</ssd:System>", f"\n{written}</ssd:System>"))
    line = 1 + system.read_text().split("<ssc:Annotation ")[0].count("\n")
    assert f'error: {system}:{line}: "c.*" matches no output or' in run("check", str(system))[2]


@pytest.mark.parametrize("command", ["run", "check", "info"])
def test_a_missing_system(run: Any, command: str) -> None:
    code, _, stderr = run(command, "nowhere.ssd")
    assert code == 2
    assert "error: nowhere.ssd: " in stderr


@pytest.mark.parametrize(
    "words", [("info", "--signals"), ("plot",), ("view",), ("report",), ("export", "-o", "x.csv"), ("repair",)]
)
def test_a_missing_run(run: Any, words: tuple[str, ...]) -> None:
    code, stdout, stderr = run(words[0], "missing", *words[1:])
    assert (code, stdout) == (2, "")
    assert stderr.startswith(("error: missing: not the folder of a run: ", "error: --signals: missing is not the f"))
    code, stdout, _ = run(words[0], "missing", *words[1:], "--json")
    assert code == 2
    assert "missing" in json.loads(stdout)["errors"][0]["message"] + str(json.loads(stdout)["errors"][0]["file"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("export", "-o", "x.xyz"), "x.xyz: the end of the name must be one of .csv, "),
        (("export", "-o", "x.kml", "--origin", "1,2"), "origin 1,2: write LATITUDE,LONGITUDE,ALTITUDE in degrees"),
        (("export", "-o", "x.kml", "--origin", "91,2,3"), "origin 91,2,3: the latitude must be within -90 and 90"),
        (("plot", "--signal", "c.y"), '--signal c.y: results has no such signal; did you mean "'),
    ],
)
def test_wrong_options_for_a_run_have_exit_code_2(run: Any, system: Path, words: tuple[str, ...], message: str) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    code, stdout, stderr = run(words[0], "results", *words[1:])
    assert (code, stdout) == (2, "")
    assert stderr.startswith(f"error: {message}")


@pytest.mark.parametrize("command", ["run", "check"])
def test_a_description_with_two_problems(run: Any, probes: Any, command: str) -> None:
    probes.fmu()
    system = probes.ssd(probes.component("a", p="much") + probes.component("b", "missing.fmu"))
    code, stdout, stderr = run(command, str(system))
    assert (code, stdout) == (2, "")
    errors = [line for line in stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) >= 2
    assert all(re.match(r"error: \S+:\d+: |error: \S+missing.fmu: ", line) for line in errors)


def test_a_failing_fmu_has_exit_code_1(run: Any, probes: Any) -> None:
    probes.fmu()
    code, stdout, stderr = run("run", str(probes.ssd(probes.component("a", mode=3, when=1.0))))
    assert code == 1
    assert "error: a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = 0, n = 0, b = 0" in stderr.splitlines()
    assert "    it is over" in stderr
    assert stdout.startswith("failed: 1 s simulated in ")


def test_an_fmu_that_does_not_start_has_exit_code_1(run: Any, probes: Any) -> None:
    probes.fmu(guid="none")
    code, stdout, stderr = run("run", str(probes.ssd(probes.component("a"))))
    assert (code, stdout) == (1, "")
    assert "error: a: fmi2Instantiate failed: it returned NULL\n    refused: 100% of\n    the reasons\n" in stderr


def test_a_file_that_is_to_be_written_has_a_name(run: Any) -> None:
    for words, named in (("view results", "NAME.html"), ("report results", "NAME.html"), ("dialect x.xml", "NAME.py")):
        code, stdout, stderr = run(*words.split(), "-o", ".")
        assert (
            (code, stdout) == (2, "") and stderr.startswith("error: -o .: ") and stderr.endswith(f"; name it {named}\n")
        )


@pytest.mark.parametrize(
    "words",
    [
        "run {}",
        "check {}",
        "info {}",
        "report {}",
        "pack test.ssd -o {}.ssp",
        "build {}.py",
        "swap test.ssd a {}.fmu -o x",
    ],
)
def test_a_name_that_is_too_long_for_a_file(run: Any, system: Path, words: str) -> None:
    system.rename("test.ssd")
    code, stdout, stderr = run(*words.format("n" * 300).split())
    assert (code, stdout, stderr.count("error: ")) == (2, "", 1)
    assert stderr.endswith("nnn...: this name is too long for a file\n")


def test_a_system_without_anything_to_watch_is_judged_to_its_end(run: Any, system: Path) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    verdict = json.loads(Path("results/manifest.json").read_text())["verdict"]
    assert (verdict["from"], verdict["to"]) == (0.0, 2.0)


def test_an_interrupted_run_has_exit_code_130(run: Any, probes: Any) -> None:
    probes.fmu()
    code, stdout, _ = run("run", str(probes.ssd(probes.component("a", mode=6, when=0.5), stop=1e6)), "--pace", "100")
    assert code == 130
    assert stdout.startswith("interrupted: ")


RAISING = '''
from cosim import Model, Output

class CliRaising(Model):
    """Raises."""
    step_size = 0.5
    variables = (Output("y", unit="1"),)

    def do_step(self, t, h):
        table = [1.0, 2.0]
        self.m.y = table[int(t / h)]  # the culprit
        return True
'''


def test_a_traceback_reaches_the_user(run: Any, probes: Any, tmp_path: Path) -> None:
    model(tmp_path, "cli_raising.py", RAISING)
    code, stdout, stderr = run("run", str(probes.ssd(probes.workshop.component("a", "CliRaising.fmu", "y:output"))))
    assert code == 1
    assert "error: a: fmi2DoStep failed at t = 1 s: fmi2Fatal" in stderr
    assert re.search(r'File ".*cli_raising.py", line \d+, in do_step', stderr)
    assert "# the culprit" in stderr
    assert "IndexError: list index out of range" in stderr
    assert stdout.startswith("failed: 1 s simulated")


def test_arducopter_that_is_missing_is_one_message(run: Any, fmus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ARDUPILOT_SITL", raising=False)
    system = fmus.parent / "master" / "systems" / "line5-ardupilot"
    code, stdout, stderr = run("run", str(system))
    first, second = stderr[stderr.index("error: ") :].splitlines()
    assert (code, stdout) == (1, "")
    assert first == "error: drone1.autopilot: fmi2ExitInitializationMode failed at t = 0 s: fmi2Fatal"
    assert second.startswith("    there is no ArduPilot to start: set the environment variable ARDUPILOT_SITL or the ")


def test_check(run: Any, system: Path, probes: Any) -> None:
    code, stdout, _ = run("check", str(system), "--set", "a.p=2", "--until", "5")
    assert code == 0
    assert stdout == f"{system}: 2 instances, 1 connection, 0 radio nodes, 10 steps of 0.5 s: no problems\n"
    assert probes.calls == []


def test_variants(run: Any, probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    for name, value in (("SystemStructure", 1.0), ("hot", 9.0)):
        path = probes.ssd(probes.component("a", p=value), name=f"{name}.ssd")
        path.write_text(path.read_text().replace('name="test"', f'name="{name.lower()}"'))
    assert run("run", str(probes.root), "--variant", "hot", "-o", "results")[0] == 0
    assert pq.read_table(tmp_path / "results/signals.parquet")["a.y"][-1].as_py() == 9.0
    assert run("check", str(probes.root), "--variant", "hot")[0] == 0
    assert "set by the system" in run("info", str(probes.root), "--variant", "hot")[1]
    code, _, stderr = run("check", str(probes.root), "--variant", "cold")
    assert (code, 'there is no variant "cold"; valid: "hot", "systemstructure"' in stderr) == (2, True)


def test_explain(run: Any, system: Path) -> None:
    code, stdout, _ = run("explain", str(system), "b.u", "--set", "b.u=3")
    assert (
        code == 0
        and "start value 3.0 m, set by --set b.u=3.0" in stdout
        and "driven from the start on by a.y" in stdout
    )
    code, _, stderr = run("explain", str(system), "b.x")
    assert code == 2 and 'there is no variable "b.x"' in stderr


def test_new_takes_the_folder_fmus_only_if_all_that_it_needs_is_there(
    run: Any, fmus: Path, system: Path, tmp_path: Path
) -> None:
    """A model of one's own has been built into it."""
    (tmp_path / "fmus").mkdir()
    (tmp_path / "probe.fmu").rename(tmp_path / "fmus" / "Quadrotor.fmu")
    code, _, stderr = run("new", "line", "--drones", "3", "-o", "swarm")
    assert code == 0, stderr
    assert f'source="{Path(os.path.relpath(fmus, tmp_path / "swarm")).as_posix()}/Quadrotor.fmu"' in (
        tmp_path / "swarm" / "drone.ssd"
    ).read_text(encoding="utf-8")
    for name in ("Quadrotor", "Autopilot", "LineAgent"):
        (tmp_path / "fmus" / f"{name}.fmu").write_bytes((fmus / f"{name}.fmu").read_bytes())
    assert run("new", "line", "--drones", "3", "-o", "own")[0] == 0
    assert 'source="../fmus/Quadrotor.fmu"' in (tmp_path / "own" / "drone.ssd").read_text(encoding="utf-8")


def test_a_command_that_is_printed_can_be_copied(run: Any, fmus: Path, system: Path, tmp_path: Path) -> None:
    code, stdout, _ = run("new", "line", "--drones", "3", "-o", "my swarm", "--fmus", str(fmus))
    assert (code, stdout) == (0, "my swarm: line of 3 drones; uav-cosim run 'my swarm'\n")
    code, stdout, _ = run("pack", str(system), "-o", "my s.ssp")
    assert code == 0 and stdout.endswith(" MB; uav-cosim run 'my s.ssp'\n")


def test_notes_are_shown(run: Any, probes: Any) -> None:
    probes.fmu()
    system = probes.workshop.ssd("s.ssd", probes.workshop.system(probes.component("a")))
    code, _, stderr = run("check", str(system), "--until", "1")
    assert code == 0
    assert "note: the system names no start time: it starts at 0 s\n" in stderr


def test_info_of_an_fmu_a_system_and_a_run(run: Any, system: Path) -> None:
    code, stdout, _ = run("info", "probe.fmu")
    assert code == 0 and stdout.startswith("Unit\nFMI 2.0, GUID probe, step size 0.5 s\n")
    code, stdout, _ = run("info", str(system))
    assert code == 0 and stdout.startswith("test: SSP 1.0, 2 instances\n")
    assert run("run", str(system), "-o", "results")[0] == 0
    code, stdout, _ = run("info", "results")
    assert code == 0 and stdout.startswith("test: done, 2 s simulated in ")
    code, stdout, _ = run("info", "Quadrotor")
    assert code == 0 and stdout.startswith("Quadrotor: Quadrotor X: rigid body, ")
    said = (2, "", "error: --variables: results is not an FMU\n")
    assert run("info", "results", "--variables") == said
    Path("results/signals.parquet").write_bytes(b"PAR1")
    code, _, stderr = run("info", "results")
    assert code == 2 and "error: results: is not the complete result of a run: " in stderr


@pytest.mark.parametrize(
    "words",
    [
        ("info", "results"),
        ("plot", "results", "--signal", "a.y"),
        ("view", "results"),
        ("compare", "results", "results"),
        ("export", "results", "-o", "x.csv"),
        ("export", "results", "-o", "x.mat"),
    ],
)
def test_signals_that_are_damaged_since_are_named(run: Any, system: Path, words: tuple[str, ...]) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    file = Path("results/signals.parquet")
    data = file.read_bytes()
    columns = len(data) - 8 - int.from_bytes(data[-8:-4], "little")  # then the footer, its length and a mark
    file.write_bytes(data[:4] + b"\xff" * (columns - 4) + data[columns:])
    code, stdout, stderr = run(*words)
    told = "results/signals.parquet: damaged since it was written; run the system again ("
    assert (code, stdout, stderr.count("error: ")) == (2, "", 1) and told in stderr.splitlines()[-1]
    assert not Path(words[-1]).is_file()


def test_tables_are_not_cut_where_the_output_is_no_terminal(run: Any, workshop: Any, variable: Any) -> None:
    name, text = "a" * 70, "what this is for, " * 10
    described = f'<ScalarVariable description="{text}end"'
    workshop.fmu("long.fmu", variable(name, "output").replace("<ScalarVariable", described), step="0.1")
    code, stdout, _ = run("info", "long.fmu")
    assert code == 0
    assert [line.split() for line in stdout.splitlines() if name in line] == [
        [name, "output", "Real", *f"{text}end".split()]
    ]


def test_swap_and_run(run: Any, system: Path, probes: Any, tmp_path: Path) -> None:
    probes.fmu("other.fmu", guid="other")
    code, stdout, stderr = run("swap", str(system), "b", "other.fmu", "-o", "swapped.ssd")
    assert code == 0, stderr
    assert stdout.endswith(": b is now other.fmu\n")
    assert run("run", "swapped.ssd", "-o", "results")[0] == 0
    assert probes.calls[:2] == ["a: instantiate probe", "b: instantiate other"]
    code, _, stderr = run("swap", str(system), "c", "other.fmu", "-o", "no.ssd")
    assert code == 2 and "error: " in stderr
    both = "error: swap: give either -o SYSTEM for a new system, or --in-place to change this one\n"
    assert run("swap", str(system), "b", "other.fmu") == (2, "", both)
    assert run("swap", str(system), "b", "other.fmu", "-o", "no.ssd", "--in-place") == (2, "", both)
    before = system.read_bytes()
    assert run("swap", str(system), "b", "other.fmu", "--in-place")[0] == 0
    assert system.read_bytes() == before.replace(b'name="b" source="probe.fmu"', b'name="b" source="other.fmu"')


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (("view", "results", "--no-open"), "results/view.html"),
        (("report", "results"), "results/report.html"),
        (("graph", "s.ssd"), "test.svg"),
        (("new", "agent", "mine.py"), "mine.py"),
        (("pack", "s.ssd", "-o", "s.ssp"), "s.ssp"),
    ],
)
def test_no_part_of_a_file_is_left_on_a_full_disk(
    run: Any, system: Path, tmp_path: Path, words: tuple[str, ...], file: str
) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    with room_of(1000):
        code, stdout, stderr = run(*words)
    assert (code, stdout) == (1, "")
    assert stderr.startswith(f"error: {file}: ") and stderr.endswith("cannot be written: File too large\n")
    assert not (tmp_path / file).exists()
    assert run(*words)[0] == 0
    assert (tmp_path / file).stat().st_size > 1000


def test_no_part_of_a_module_of_messages_is_left_on_a_full_disk(run: Any, tmp_path: Path) -> None:
    fields = "".join(f'<field type="float" name="f{i}"/>' for i in range(40))
    (tmp_path / "swarm.xml").write_text(
        f'<mavlink><messages><message id="42100" name="BID">{fields}</message></messages></mavlink>'
    )
    with room_of(1000):
        assert run("dialect", "swarm.xml", "-o", "swarm.py") == (
            1,
            "",
            "error: swarm.py: cannot be written: File too large\n",
        )
    assert not (tmp_path / "swarm.py").exists()
    assert run("dialect", "swarm.xml", "-o", "swarm.py")[0] == 0
    assert (tmp_path / "swarm.py").stat().st_size > 1000


def test_a_view_takes_the_place_of_no_other_file(run: Any, system: Path, tmp_path: Path) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    before = {file: file.read_bytes() for file in (tmp_path / "results").iterdir()}
    for name in ("results/manifest.json", "results/signals.parquet", "notes.txt"):
        page = Path(name).with_suffix(".html")
        text = f"error: -o {name}: a view is an HTML page; name it {page}\n"
        assert run("view", "results", "--no-open", "-o", name) == (2, "", text)
    assert {file: file.read_bytes() for file in (tmp_path / "results").iterdir()} == before


def test_exports_are_checked_before_any_is_written(run: Any, system: Path, tmp_path: Path) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    (tmp_path / "taken").touch()
    code, stdout, stderr = run("export", "results", "--csv", "r.csv", "--tlog", "taken")
    assert (code, stdout) == (2, "")
    assert stderr == "error: taken: is a file; --tlog writes a folder: give a new one\n"
    code, stdout, stderr = run("export", "results", "--csv", "r.csv", "-o", "r.csv")
    assert (code, stdout) == (2, "")
    assert stderr == "error: export: r.csv is given twice; give each format a file of its own\n"
    assert not (tmp_path / "r.csv").exists()
    code, stdout, stderr = run("export", "results", "--csv", "r.csv", "--tlog", "logs")
    assert (code, stdout) == (1, "r.csv\n") and "no packets were recorded" in stderr


@pytest.mark.parametrize("words", [("view", "none", "--rerun"), ("export", "none", "--csv", "none/deep/r.csv")])
def test_no_folder_is_made_where_no_run_is(run: Any, tmp_path: Path, words: tuple[str, ...]) -> None:
    code, stdout, stderr = run(*words)
    assert (code, stdout) == (2, "")
    assert "error: none: not the folder of a run: there is no such folder; a run prints its own" in stderr
    assert not (tmp_path / "none").exists()


def test_export(run: Any, system: Path, tmp_path: Path) -> None:
    assert run("run", str(system), "-o", "results", "--record", "?.y")[0] == 0
    code, stdout, _ = run("export", "results", "--csv", "r.csv")
    assert (code, stdout) == (0, "r.csv\n")
    assert (tmp_path / "r.csv").read_text().splitlines()[0].replace('"', "") == "time,a.y,b.y"


def test_a_reader_of_an_export_may_have_had_enough(run: Any, system: Path, tmp_path: Path) -> None:
    """As `head` does; Python then has nobody to tell."""
    assert run("run", str(system), "--step", "0.0005", "-o", "results")[0] == 0
    command = [str(Path(sys.executable).with_name("uav-cosim")), "export", "results", "-o", "-"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline().startswith(b'"time",')
        process.stdout.close()
        said = [line for line in process.stderr.read().splitlines() if not line.endswith(b" ...")]
    assert (process.returncode, said) == (1, [])


def test_build(run: Any, tmp_path: Path) -> None:
    (tmp_path / "cli_built.py").write_text(RAISING.replace("CliRaising", "CliBuilt"))
    code, stdout, stderr = run("build", "cli_built.py", "-o", "fmus")
    assert code == 0, stderr
    assert stdout == "fmus/CliBuilt.fmu: interpreted\n"
    code, stdout, stderr = run("build", "line5-ardupilot", "ArduPilotSITL", "-o", "fmus", "--interpreted")
    assert code == 0, stderr
    assert stdout.splitlines() == [f"fmus/{m}.fmu: interpreted" for m in ("ArduPilotSITL", "LineAgent", "Quadrotor")]
    code, _, stderr = run("build", "Nonexistent", "-o", "fmus")
    assert code == 2 and "error: no model called Nonexistent: there are " in stderr
    code, _, stderr = run("build", "quadrotor", "-o", "fmus")
    assert code == 2 and 'error: no model called quadrotor: did you mean "Quadrotor"? Valid are also shipped' in stderr
    code, _, stderr = run("build", "nowhere.py", "-o", "fmus")
    assert code == 2 and "nowhere.py: no such file" in stderr


CUTTING = '''
from cosim import Input, Model, Output, kernel

@kernel
def start(m):
    return 0

@kernel
def advance(m, t, h):
    m.n = 2.5 * m.u
    return 0

class CliCutting(Model):
    """Cuts fractions off."""
    step_size = 0.5
    variables = (Input("u"), Output("n", type=int))
    kernels = (start, advance)
'''


def test_build_doubts_that_an_int_is_to_get_a_float(run: Any, tmp_path: Path) -> None:
    (tmp_path / "cli_cutting.py").write_text(CUTTING)
    doubt = "cli_cutting.py:10: m.n is an int, so the fraction of 2.5 * m.u is cut off; "
    doubt += "declare a float, or write int(...) or round(...)"
    code, stdout, stderr = run("build", "cli_cutting.py")
    assert (code, stdout, stderr) == (0, "fmus/CliCutting.fmu: compiled\n", f"note: {doubt}\n")
    sys.modules.pop("cli_cutting")
    (made,) = json.loads(run("build", "cli_cutting.py", "--json")[1])["fmus"]
    assert made == {"file": "fmus/CliCutting.fmu", "model": "CliCutting", "state": "up to date", "note": doubt}


def test_build_into_a_place_that_cannot_be_written(run: Any, tmp_path: Path) -> None:
    (tmp_path / "cli_nowhere.py").write_text(RAISING.replace("CliRaising", "CliNowhere"))
    code, stdout, stderr = run("build", "cli_nowhere.py", "-o", "cli_nowhere.py/fmus")
    assert (code, stdout, stderr) == (1, "", "error: cli_nowhere.py/fmus: cannot be written: Not a directory\n")


def test_build_of_all_models_leaves_out_those_that_fmi_3_cannot_have(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of a package, of which one has no kernels: it is named, the others are built."""
    known = {model.__name__: model for model in models_of_package("cosim_models")}
    two = [known["ArduPilotSITL"], known["PointMass"]]
    monkeypatch.setattr("cosim.build.models_of_package", lambda package: two)
    code, stdout, stderr = run("build", "--fmi", "3", "-o", "fmus")
    assert code == 0, stderr
    assert stdout.splitlines()[0] == (
        "ArduPilotSITL: not built: it has no kernels, and interpreted FMUs are FMI 2 only"
    )
    assert [file.name for file in (tmp_path / "fmus").iterdir()] == ["PointMass.fmi3.fmu"]
    code, _, stderr = run("build", "ArduPilotSITL", "--fmi", "3", "-o", "fmus")
    assert code == 2 and "error: ArduPilotSITL has no kernels" in stderr


def test_as_a_process(system: Path, forks: Forks, tmp_path: Path) -> None:
    """The installed command, with the user's own cache: a good run, a bad description, help without arguments."""
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(Path(sys.executable).with_name("uav-cosim")), *arguments]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    done = call("run", str(system), "-o", "results")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("done: 2 s simulated in ")
    assert (tmp_path / "results" / "manifest.json").is_file()
    bad = forks.run(["run", "nowhere.ssd"], tmp_path, environment)
    assert bad.returncode == 2
    *stages, said = bad.stderr.splitlines()  # of stages that take longer than a second
    assert said.startswith("error: nowhere.ssd: ") and all(stage.endswith(" ...") for stage in stages), bad.stderr
    assert "Traceback" not in bad.stderr
    usage = call()
    assert "Usage: uav-cosim" in usage.stdout + usage.stderr


FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="a device of Linux")
@pytest.mark.parametrize("words", ["--version", "--help", "run --help"])
def test_help_on_a_full_disk_is_one_error(tmp_path: Path, words: str) -> None:
    command = [str(Path(sys.executable).with_name("uav-cosim")), *words.split()]
    with FULL.open("w") as full:
        done = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    error = "error: standard output: cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (1, error)


THREADS = """
import sys
from cosim_master.cli import main
sys.argv[1:] = ["check", "nowhere.ssd"]
try:
    main()
except SystemExit:
    import numpy
    from threadpoolctl import threadpool_info
    print([library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"])
"""


LOOKED = """
import atexit, gc, sys
atexit.register(lambda: print("frozen:", gc.get_freeze_count() > 10_000))  # called last
gc.callbacks.append(lambda phase, info: looked.append(info["generation"]))
looked = []
from cosim_master.cli import main
looked.clear()
sys.argv[1:] = ["check", "nowhere.ssd"]
try:
    main()
finally:
    print("oldest:", looked.count(2))
"""


@pytest.mark.skipif(not FULL.exists(), reason="a device of Linux")
@pytest.mark.parametrize(
    "words",
    [
        ("info", "results", "--signals"),
        ("info", "results", "--json"),
        ("explain", "s.ssd", "b.u"),
        ("plot", "results", "--signal", "a.y", "--format", "svg"),
    ],
)
def test_standard_output_on_a_full_disk_is_one_error(
    run: Any, system: Path, forks: Forks, tmp_path: Path, words: tuple[str, ...]
) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    done = forks.run([*words], tmp_path, os.environ, FULL)
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if not line.endswith(" ...")]  # of what takes over a second
    assert said == ["error: standard output: cannot be written: No space left on device"]


@pytest.mark.skipif(not FULL.exists(), reason="a device of Linux")
def test_errors_as_json_on_a_full_disk_are_still_told(forks: Forks, tmp_path: Path) -> None:
    done = forks.run(["build", "nowhere.py", "--json"], tmp_path, os.environ, FULL)
    assert done.returncode == 1
    first, *others = done.stderr.splitlines()
    assert first.startswith("error: ") and "nowhere" in first
    assert others == ["error: standard output: cannot be written: No space left on device"]


TWICE = """
import json, os, sys
from cosim_master.cli import main
import cosim_master.cli.verbs.run, cosim_master.execution.simulate
for name, words in json.loads(sys.argv.pop()).items():
    if os.fork() == 0:
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), 1)
        sys.argv[1:] = words
        break
    if code := os.waitstatus_to_exitcode(os.wait()[1]):
        sys.exit(code)
else:
    os._exit(0)
"""
"""A process for several commands, whose imports they share: its streams have the encoding that Python gives them."""


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_names_that_a_terminal_cannot_show_are_escaped(run: Any, system: Path, tmp_path: Path, encoding: str) -> None:
    words = ["run", str(system), "-o", "ü漢", "--force"]
    commands = json.dumps({"text": words, "json": [*words, "--json"]})
    environment = {**os.environ, "LC_ALL": "C", "PYTHONIOENCODING": encoding}
    done = subprocess.run(
        [sys.executable, "-c", TWICE + TO_ITS_END, commands],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "json").read_text("utf-8"))["folder"] == "ü漢"
    shown = {"ascii": r"\xfc\u6f22", "latin-1": r"ü\u6f22", "utf-8": "ü漢"}[encoding]
    assert f"results: {shown}" in (tmp_path / "text").read_text(encoding)


def test_options_of_systems_are_not_taken_for_files(run: Any, tmp_path: Path) -> None:
    for option, value in (("-o", "folder"), ("--drones", "3"), ("--until", "5"), ("--spacing", "5"), ("--seed", "2")):
        text = f"error: new: {option} belongs to a new system; with FILE (law.py), leave it out\n"
        assert run("new", "agent", "law.py", option, value) == (2, "", text)
    assert list(tmp_path.glob("*.py")) == []


def test_a_file_that_is_given_twice_is_built_once(run: Any) -> None:
    assert run("new", "model", "thing_twice.py")[0] == 0
    code, stdout, stderr = run("build", "thing_twice.py", "thing_twice.py", "-o", "fmus", "--interpreted")
    assert (code, stderr) == (0, "") and len(stdout.splitlines()) == 1


def test_an_fmu_is_one_whatever_the_case_of_its_name(run: Any, probes: Any, tmp_path: Path) -> None:
    shutil.copy(probes.fmu(), tmp_path / "PROBE.FMU")
    code, stdout, _ = run("info", "PROBE.FMU", "--json")
    assert code == 0 and json.loads(stdout)["kind"] == "fmu"


def test_a_kind_of_figure_that_is_given_twice_is_drawn_once(run: Any, system: Path) -> None:
    assert run("run", str(system), "-o", "results")[0] == 0
    code, stdout, _ = run("plot", "results", "--signal", "a.y", "--format", "svg", "--format", "svg", "--json")
    assert code == 0
    (file,) = json.loads(stdout)["files"]
    assert file.endswith(".svg")


def test_a_name_that_is_too_long_is_refused(run: Any, system: Path) -> None:
    name = "x" * 300
    error = f"error: {name}: cannot hold the results of a run: File name too long\n"
    assert run("run", str(system), "-o", name) == (2, "", error)


def test_settings_without_a_value_are_refused(run: Any, system: Path) -> None:
    """As of a shell variable that is not set; a default would take the place of the system's own value."""
    for name, what in (("network.latency", "a number from 0"), ("network.neighbours", "a whole number from 1")):
        code, stdout, stderr = run("run", str(system), "--set", f"{name}=")
        assert (code, stdout) == (2, "") and f"{name}= must be {what}" in stderr


def test_imports_of_a_command_are_not_looked_through_for_garbage(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", LOOKED], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "oldest: 0\nfrozen: True\n"), done.stderr


_PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


@pytest.mark.skipif(sys.platform == "darwin", reason="numpy may have Apple's library")
@pytest.mark.skipif(_PROCESSORS < 2, reason="numpy has at most one thread for each processor")
@pytest.mark.parametrize(("asked_for", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_matrices_are_multiplied_in_one_thread_unless_more_are_asked_for(
    tmp_path: Path, asked_for: dict[str, str], threads: int
) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", THREADS]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment | asked_for, capture_output=True, text=True, check=False
    )
    assert done.stdout == f"[{threads}]\n", done.stderr


def test_dialect(run: Any, tmp_path: Path) -> None:
    message = '<message id="42100" name="HELLO"><field type="float" name="x"/></message>'
    xml = f"<mavlink><messages>{message}</messages></mavlink>"
    (tmp_path / "swarm.xml").write_text(xml)
    assert run("dialect", "swarm.xml", "-o", "swarm.py") == (0, "swarm.py: HELLO\n", "")
    assert "def encode_hello(payload: Bytes, x: float) -> int:" in (tmp_path / "swarm.py").read_text()
    error = "error: -o swarm.xml: it is a Python module; name it swarm.py\n"
    assert run("dialect", "swarm.xml", "-o", "swarm.xml") == (2, "", error)
    assert (tmp_path / "swarm.xml").read_text() == xml
    code, _, stderr = run("dialect", "none.xml", "-o", "swarm.py")
    assert (code, stderr) == (2, "error: none.xml: No such file or directory\n")
    (tmp_path / "bad.xml").write_text("<swarm/>")
    code, _, stderr = run("dialect", "bad.xml", "-o", "swarm.py")
    assert (code, stderr) == (2, "error: bad.xml: the root of a dialect is <mavlink>, not <swarm>\n")


def test_findings_are_notes_and_with_strict_errors(run: Any, probes: Any) -> None:
    """Five connections to the system's own connectors are written as OMSimulator does, with empty elements."""
    probes.fmu()
    names = "vwxyz"
    connectors = "".join(f'<ssd:Connector name="{name}" kind="input"/>' for name in names)
    made: Path = probes.ssd("".join(probes.component(name) for name in names))
    wires = "\n".join(
        f'<ssd:Connection startElement="" startConnector="{name}" endElement="{name}" endConnector="u"/>'
        for name in names
    )
    text = made.read_text()
    text = text.replace("<ssd:Elements>", f"<ssd:Connectors>{connectors}</ssd:Connectors><ssd:Elements>", 1)
    made.write_text(text.replace("</ssd:Elements>", f"</ssd:Elements><ssd:Connections>{wires}</ssd:Connections>", 1))
    finding = 'startElement="" is read as if it were absent: this end belongs to the system itself'
    code, _, stderr = run("check", str(made))
    assert code == 0, stderr
    assert stderr.count(f": {finding}") == 3
    assert 'note: and 2 more notes of this kind: startElement="" or endElement=""' in stderr
    for verb in ("check", "run"):
        code, _, stderr = run(verb, "--strict", str(made))
        assert code == 2
        assert stderr.count(f": {finding}") == 5
        assert stderr.count("error: ") == 5


def test_a_system_without_components_or_outputs(run: Any, probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    made = probes.ssd("")
    code, _, stderr = run("check", str(made))
    assert (code, "note: the system has no components" in stderr) == (0, True), stderr
    code, _, stderr = run("run", str(made), "-o", "empty", "--record", "*")
    assert code == 0, stderr
    assert pq.read_table(tmp_path / "empty" / "signals.parquet")["time"].to_pylist() == [0.0, 2.0]
    code, _, stderr = run("run", str(made), "--record", "a.*")
    assert (code, stderr.splitlines()[-1]) == (
        2,
        'error: --record: "a.*" matches no output or local variable: the system has none',
    )
