"""docs/command-line.md tells the truth: its tables, its exit codes, its JSON documents; help and completion."""

from __future__ import annotations

import json
import os
import re
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import typer.main
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.cli.reference import HEADING, tables
from tests.master.results.test_figures import consensus_run
from tests.master.terminal import COMMAND

pytestmark = pytest.mark.usefixtures("own_cache")
DOCUMENT = (Path(__file__).parents[3] / "docs" / "command-line.md").read_text(encoding="utf-8")
VERBS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
DOCUMENTED = dict(re.findall(r"```json ([\w-]+)\n(.*?)```", DOCUMENT, re.DOTALL))


def test_the_tables_are_those_of_the_command() -> None:
    """If not: python -m cosim_master.cli.reference docs/command-line.md."""
    assert DOCUMENT[DOCUMENT.index(HEADING) :] == tables()


@pytest.mark.parametrize("name", sorted(VERBS))
def test_every_verb_has_an_example_its_switches_and_json(name: str) -> None:
    shown = CliRunner().invoke(app, [name, "--help"])
    assert shown.exit_code == 0
    assert re.search(rf"Examples?:\n +uav-cosim {name}\b", shown.stdout)
    assert all(switch in shown.stdout for switch in ("-q, --quiet", "-v, --verbose", "--json"))
    blocks = [block for block in DOCUMENTED if block.partition("-")[0] == name]
    assert blocks or name in ("convert", "graph", "new", "report", "view"), "its JSON document is not described"


def test_help_lists_the_verbs_from_the_first_that_one_needs_with_whole_sentences() -> None:
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "80"}).stdout
    listed = re.findall(r"^  (\w+)  +[A-Z]", shown[shown.index("Commands:") :], re.MULTILINE)
    assert sorted(listed) == sorted(VERBS)
    assert listed[:3] == ["run", "info", "view"]
    assert "..." not in shown[shown.index("Commands:") :]
    words = " ".join(shown.split())
    assert "One HTML page".casefold() in words.casefold() and "exit code 0: equal, 1: different, 2: they" in words


@pytest.mark.parametrize("name", ["", *sorted(VERBS)])
def test_examples_name_no_folder_of_the_source_tree(name: str) -> None:
    """A package that pip installed has none."""
    assert "master/" not in CliRunner().invoke(app, [*name.split(), "--help"]).stdout


def test_help_says_that_a_shipped_system_has_a_name() -> None:
    for name in ("run", "check", "info"):
        assert "shipped system (line5)" in " ".join(CliRunner().invoke(app, [name, "--help"]).stdout.split())


def test_defaults_are_shown() -> None:
    shown = " ".join(CliRunner().invoke(app, ["run", "--help"]).stdout.split())
    assert "[default: (out/NAME, or out/NAME-2, ... if that holds a run of other inputs)]" in shown
    assert "[default: (as fast as it can)]" in shown


@pytest.mark.parametrize("option", [["-o", ""], ["--out", ""], ["--out="]])
def test_an_output_without_a_name_is_refused(option: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [COMMAND, "new", "line", "--drones", "2", *option], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2 and not list(tmp_path.iterdir())
    assert done.stderr.startswith('error: -o "": the name is empty, as that of a shell variable that is not set; try .')


def test_version() -> None:
    shown = CliRunner().invoke(app, ["--version"])
    assert (shown.exit_code, shown.stdout) == (0, f"uav-cosim {version('uav-cosim')}\n")


def test_completion_in_bash() -> None:
    def completed(words: str) -> list[str]:
        asked = {"_UAV_COSIM_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
        done = subprocess.run([COMMAND], env=os.environ | asked, capture_output=True, text=True, check=True)
        return sorted(done.stdout.split())

    assert completed("uav-cosim ex") == ["explain", "export"]
    assert completed("uav-cosim run --check") == ["--checkpoint-every"]


def is_as_documented(block: str, document: Any) -> bool:
    """Whether a JSON document has the keys and the kinds of values of that in docs/command-line.md."""
    return fits(shape(json.loads(DOCUMENTED[block])), shape(document))


def shape(value: Any) -> Any:
    """The keys of a document, and the kinds of its values; what may be missing, or has keys of its own, is not told."""
    if isinstance(value, dict):
        return {key: shape(one) for key, one in value.items()} if value else "object"
    if isinstance(value, list):
        return [shape(value[0])] if value else "list"
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__


def fits(documented: Any, found: Any) -> bool:
    """Whether a document has the shape of another; null, {} and [] there stand for anything of their kind."""
    if documented in ("NoneType",) or found == "NoneType":
        return True
    if documented == "object" or found == "object":
        return isinstance(found, dict) or found == documented
    if isinstance(documented, dict):
        return (
            isinstance(found, dict)
            and documented.keys() == found.keys()
            and all(fits(documented[key], found[key]) for key in documented)
        )
    if isinstance(documented, list) or isinstance(found, list):
        return documented == "list" or found == "list" or fits(documented[0], found[0])
    return bool(documented == found) or {documented, found} == {"number", "str"}


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The JSON document of a call in tmp_path, which fits the documented one."""
    monkeypatch.chdir(tmp_path)

    def made(block: str, *arguments: str, code: int = 0) -> Any:
        result = CliRunner().invoke(app, [*arguments, "--json"])
        assert result.exit_code == code, result.stderr
        document = json.loads(result.stdout)
        assert is_as_documented(block, document), document
        return document

    return made


@pytest.fixture
def system(probes: Any) -> Path:
    probes.fmu()
    made: Path = probes.ssd(probes.component("a", u=1.0) + probes.component("b"), "a/y b/u")
    return made


def test_json_of_systems(call: Any, system: Path, probes: Any) -> None:
    checked = call("check", "check", "s.ssd", "--init")
    assert {one["kind"] for one in checked.pop("verdict")["findings"]} == {"open input"}  # notes: of another tool
    assert checked == {
        "system": "s.ssd",
        "instances": 2,
        "connections": 1,
        "radio_nodes": 0,
        "steps": 4,
        "base_step": 0.5,
        "initialized": True,
        "loops": [],
        "notes": ["probe.fmu: it steps by 0.5 s, which the FMU proposes (DefaultExperiment); --step gives another"],
        "errors": [],
    }
    assert call("explain", "explain", "s.ssd", "b.mode")["explanation"] == [
        "b.mode: parameter of probe.fmu, Integer",
        "start value 0, of the FMU: not set elsewhere",
    ]
    found = call("info-system", "info", "s.ssd")
    assert found["connections"] == [{"from": "a", "to": "b", "count": 1}]
    assert [(one["name"], one["start_values"]) for one in found["instances"]] == [("a", {"u": 1.0}), ("b", {})]
    assert call("info-fmu", "info", "probe.fmu")["variables"][0] == {
        "name": "u",
        "causality": "input",
        "type": "Real",
        "unit": "m",
        "start": 0.0,
        "description": "",
    }
    probes.fmu("other.fmu", guid="other")
    assert call("swap", "swap", "s.ssd", "b", "other.fmu", "-o", "new.ssd") == {"files": ["new.ssd"], "notes": []}
    assert call("plot", "graph", "s.ssd") == {"files": ["test.svg"]}
    assert call("pack", "pack", "s.ssd", "-o", "s.ssp")["members"][0] == "SystemStructure.ssd"


def test_json_of_runs(call: Any, system: Path, tmp_path: Path) -> None:
    done = call("run", "run", "s.ssd")
    assert (done["outcome"], done["error"], done["folder"], done["simulated_s"]) == ("done", None, "out/s", 2.0)
    found = call("info-run", "info", "out/s")
    assert (found["kind"], found["rows"], found["signals"][0]) == (
        "run",
        5,
        {"name": "time", "type": "double", "unit": "s"},
    )
    assert call("export", "export", "out/s", "-o", "r.csv", "--numbers") == {
        "files": ["r.csv"],
        "notes": ["left out, as text: a.r, b.r"],
    }
    assert call("compare", "compare", "out/s", "out/s")["equal"] is True
    consensus_run(tmp_path / "flown", last_step=1)
    files = call("plot", "plot", "flown", "--signal", "drone1.agent.step")["files"]
    assert files == ["flown/signals.png", "flown/signals.svg"]


MODEL = '''
from cosim import Model, Output

class JsonBuilt(Model):
    """Steps."""
    step_size = 0.5
    variables = (Output("y", unit="1"),)

    def do_step(self, t, h):
        return True
'''


def test_json_of_makers(call: Any, tmp_path: Path) -> None:
    (tmp_path / "json_built.py").write_text(MODEL)
    (built,) = call("build", "build", "json_built.py")["fmus"]
    assert (built["file"], built["model"], built["state"]) == ("fmus/JsonBuilt.fmu", "JsonBuilt", "interpreted")
    message = '<message id="42100" name="BID"><field type="float" name="x"/></message>'
    (tmp_path / "swarm.xml").write_text(f"<mavlink><messages>{message}</messages></mavlink>")
    assert call("dialect", "dialect", "swarm.xml", "-o", "swarm.py") == {"files": ["swarm.py"], "messages": ["BID"]}


def test_json_of_errors(call: Any, probes: Any) -> None:
    probes.fmu()
    probes.ssd(probes.component("a", p="much"))
    (problem,) = call("errors", "check", "s.ssd", code=2)["errors"]
    assert (
        problem["file"].endswith("s.ssd")
        and isinstance(problem["line"], int)
        and problem["message"].startswith('"p" is given as ')
    )
    assert call("errors", "run", "nowhere.ssd", code=2)["errors"][0]["file"] == "nowhere.ssd"
    assert call("errors", "build", "Nothing", code=2)["errors"][0]["message"].startswith("no model called Nothing: ")
    both = "swap: give either -o SYSTEM for a new system, or --in-place to change this one"
    assert call("errors", "swap", "s.ssd", "a", "b.fmu", code=2) == {
        "errors": [{"file": None, "line": None, "message": both}]
    }


def test_errors_of_a_model_have_their_places(call: Any, tmp_path: Path) -> None:
    lines = [
        "from cosim.kernel import kernel",
        "from cosim.model import Input, Model, Output",
        "@kernel",
        "def start(m):",
        "    return 0",
        "@kernel",
        "def advance(m, t, h):",
        "    m.z = 1.0",
        "    m.uu = 2.0",
        "    return 0",
        "class Gauge(Model):",
        '    """A gauge."""',
        "    step_size = 0.01",
        '    variables = (Input("u", shape=3), Output("y", shape=3))',
        "    kernels = start, advance",
    ]
    (tmp_path / "json_gauge.py").write_text("\n".join(lines) + "\n")
    assert call("errors", "build", "json_gauge.py", code=2)["errors"] == [
        {"file": "json_gauge.py", "line": 8, "message": 'Gauge: no variable "z" in Gauge; there are u, y'},
        {"file": "json_gauge.py", "line": 9, "message": 'Gauge: no variable "uu" in Gauge; did you mean "u"?'},
    ]
    (tmp_path / "json_gauge.py").rename("text_gauge.py")
    assert CliRunner().invoke(app, ["build", "text_gauge.py"]).stderr.splitlines() == [
        'error: Gauge: text_gauge.py:8: no variable "z" in Gauge; there are u, y',
        'error: Gauge: text_gauge.py:9: no variable "uu" in Gauge; did you mean "u"?',
    ]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "line5", "--step", "0"], "--step 0: give a step size in s, a positive number"),
        (
            ["new", "line", "--drones", "5", "--spacing", "-10"],
            "--spacing -10: give a distance in m, a positive number",
        ),
        (["run", "line5", "--until", "soon"], "Invalid value for '--until': "),  # the rest is that of Typer's version
        (["check"], "Missing argument '"),
    ],
)
def test_json_of_wrong_words(call: Any, words: list[str], message: str) -> None:
    (error,) = call("errors", *words, code=2)["errors"]
    assert error.pop("message").startswith(message)
    assert error == {"file": None, "line": None}


def test_a_run_that_failed_is_not_good(call: Any, probes: Any) -> None:
    probes.fmu()
    probes.ssd(probes.component("a", mode=3, when=1.0))
    failed = call("run", "run", "s.ssd", code=1)
    assert (failed["outcome"], failed["verdict"]["good"]) == ("failed", False)
    assert failed["verdict"]["failures"] == failed["verdict"]["warnings"] == 0
    assert call("info-run", "info", "out/s")["verdict"]["good"] is False


def test_csv_on_standard_output(system: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["run", "s.ssd", "--record", "?.y"]).exit_code == 0
    for option in ("-o", "--csv"):
        shown = CliRunner().invoke(app, ["export", "out/s", option, "-"])
        assert shown.exit_code == 0
        assert shown.stdout.splitlines()[:2] == ['"time","a.y","b.y"', "0.0,1.25,1.5"]
    assert not (tmp_path / "-").exists()
    both = CliRunner().invoke(app, ["export", "out/s", "-o", "-", "--json"])
    assert both.exit_code == 2 and "both want standard output" in both.stderr
    track = CliRunner().invoke(app, ["export", "out/s", "--gpx", "-"])
    assert track.exit_code == 2 and "--gpx -: only CSV can be written to standard output" in track.stderr
    assert not (tmp_path / "-").exists()
