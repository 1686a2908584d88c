"""Reports: literal tables of recordings written by hand, text of strangers, and the page in a browser."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lxml import etree
from lxml import html as lxml_html
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import CosimError, SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.report import markup
from cosim_master.report.contents import Table, differences, parameters, programs, read_run, repetition
from cosim_master.report.page import write_report
from cosim_master.report.structure import draw_structure, groups
from cosim_master.results.reading.comparison import compare
from cosim_master.results.storage.run_folder import is_figure
from tests.master.results.test_figures import consensus_run
from tests.master.view.recordings import EVIL, evil_run
from tests.scenarios.flights import SYSTEMS


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five drones under the law of the line, and what a manifest says about them."""
    folder = consensus_run(tmp_path_factory.mktemp("report") / "flown", last_step=6)
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest |= {
        "system": {"name": "line", "path": "my systems/line.ssd"},
        "seed": 7,
        "start_time": 0.0,
        "simulated_s": 40.0,
        "wall_s": 2.0,
        "real_time_factor": 20.0,
        "settings": {"network": {"loss": "0.1"}},
        "network": {"topology": "nearest", "latency": 0.02, "loss": 0.1, "range": "INF"},
        "packets": {"sent": 10, "delivered": 9, "lost": 1},
        "changes": [{"time": 30.0, "variable": "drone3.vehicle.wind[1]", "value": 5.0}],
        "verdict": {
            "failures": 1,
            "warnings": 0,
            "findings": [{"severity": "failure", "time": 12.5, "who": ["drone2"], "text": "it does not arm"}],
        },
        "profile": {
            "fmus": [{"fmu": "A.fmu", "instances": 5, "steps": 1000, "set": 0.1, "do_step": 0.3, "get": 0.1}],
            "phases": {"initialize": 0.5},
        },
    }
    manifest["instances"]["drone2.agent"]["assigned"] = {
        "epsilon": {"name": "drone*.agent.epsilon", "text": "0.25", "where": "--set"},
        "left_sysid": {"name": "drone2.agent.left_sysid", "text": "1", "where": "/far/away/line.ssv:12"},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


@pytest.fixture(scope="module")
def written(run: Path) -> Path:
    return write_report([run])


@pytest.fixture(scope="module")
def evil(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a run whose names and texts are those of an attacker."""
    return write_report([evil_run(tmp_path_factory.mktemp("evil") / "run")])


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have no figures, which take most of their time."""
    monkeypatch.setattr("cosim_master.report.page.drawn", lambda _: iter(()))


def tables(file: Path) -> dict[str, list[list[str]]]:
    """The cells of each table, by its heading."""
    found: dict[str, list[list[str]]] = {}
    document = lxml_html.parse(file)
    for table in document.iter("table"):
        heading = next(one for one in table.itersiblings("h2", preceding=True))
        found[heading.text_content()] = [[cell.text_content() for cell in row] for row in table.iter("tr")]
    return found


def test_the_tables_have_the_values_of_the_run(written: Path) -> None:
    found = tables(written)
    assert ["simulated", "40 s"] in found["Summary"] and ["packets", "10 sent, 9 delivered, 1 lost"] in found["Summary"]
    assert found["Findings"][1:] == [["failure", "12.5", "drone2", "it does not arm"]]
    assert found["Parameters"][1:] == [
        ["network.loss", "0.1", "--set"],
        ["drone3.vehicle.wind[1]", "5", "--at 30 s"],
        ["drone2.agent.epsilon", "0.333333", "--set (drone*.agent.epsilon)"],
        ["drone2.agent.left_sysid", "1", "line.ssv:12"],
    ]
    assert found["Time in FMUs"][1:] == [["A.fmu", "5", "1000", "0.1", "0.3", "0.1", "500"]]
    agents = {row[0]: row[1:] for row in found["Agents"][1:]}
    assert list(agents) == [f"drone{i}" for i in range(1, 6)]
    assert agents["drone1"] == ["stays", "0", "0", "0", ""]
    # After step 6 the law is within 12.7 m of even spacing (the bound of 5.13 m holds after step 9).
    assert agents["drone3"][0] == "moves" and 5.13 < float(agents["drone3"][4]) < 18.89


@pytest.mark.usefixtures("without_figures")
def test_errors_are_those_of_all_instants(run: Path, tmp_path: Path) -> None:
    """Figures have a few thousand; a peak may be between them."""
    shutil.copytree(run, tmp_path / "run")
    file = tmp_path / "run" / "signals.parquet"
    table = pq.read_table(file)
    longer = table.take(np.repeat(np.arange(table.num_rows), 30_001 // table.num_rows + 1))
    n = longer.num_rows
    east = longer["drone2.vehicle.position[2]"].to_numpy().copy()
    peak = 5 * n // 6 + 1
    east[peak] += 500.0
    time = pa.array(np.linspace(0.0, 40.0, n))
    for name, values in (("time", time), ("drone2.vehicle.position[2]", pa.array(east))):
        place = longer.schema.get_field_index(name)
        longer = longer.set_column(place, longer.schema.field(place), values)
    pq.write_table(longer, file)
    target = longer["drone2.agent.target"].to_numpy()[longer["drone2.agent.step"].to_numpy() > 0]
    error = np.abs(east[-len(target) :] - target)
    assert error.max() > 400.0
    (row,) = (one for one in tables(write_report([tmp_path / "run"]))["Agents"] if one[0] == "drone2")
    assert row[2:5] == [f"{error[-1]:.4g}", f"{error.max():.4g}", f"{np.sqrt(np.mean(error**2)):.4g}"]


def test_the_page_has_every_figure_once_and_the_stamp_of_its_data(written: Path) -> None:
    document = lxml_html.parse(written)
    captions = [one.text_content() for one in document.iter("figcaption")]
    assert captions == ["FMUs and radio", "positions", "snapshots", "map", "errors", "altitude"]
    assert is_figure(written)
    (badge,) = (one for one in document.iter("span") if one.get("class", "").startswith("badge"))
    assert (badge.get("class"), badge.text_content()) == ("badge failure", "done, 1 failure")


def test_the_command_repeats_the_run(run: Path) -> None:
    assert shlex.split(repetition(read_run(run))) == [
        *("uav-cosim", "run", "my systems/line.ssd", "--set", "drone*.agent.epsilon=0.25", "--set", "network.loss=0.1"),
        *("--at", "30 drone3.vehicle.wind[1]=5.0", "--seed", "7", "--until", "40"),
    ]


def test_the_command_repeats_a_run_from_a_checkpoint(fmus: Path, tmp_path: Path) -> None:
    """To the same end, not for as long as the run went on."""
    simulate("line5", RunOptions(out=tmp_path / "begun", until=0.5, checkpoint_every=0.3))
    went_on = simulate("line5", RunOptions(out=tmp_path / "run", origin=f"{tmp_path / 'begun'}@0.3"))
    assert went_on.simulated_s == pytest.approx(0.2)
    assert repetition(read_run(tmp_path / "run")).endswith(" --seed 1 --until 0.5")


def test_the_commands_repeat_a_run_whose_radio_has_changed(
    fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice: at the checkpoint of a run, and at one of its branch, whose runs are gone."""
    system = str(SYSTEMS / "line5-points")
    common: dict[str, Any] = {"until": 3.0, "checkpoint_every": 1.0, "isolation": Isolation("none")}
    simulate(system, RunOptions(out=tmp_path / "a", overrides={"network.jitter": "0.01"}, **common))
    simulate(
        system,
        RunOptions(out=tmp_path / "b", origin=f"{tmp_path / 'a'}@1", overrides={"network.loss": "0.5"}, **common),
    )
    simulate(
        system,
        RunOptions(out=tmp_path / "c", origin=f"{tmp_path / 'b'}@2", overrides={"network.loss": "0.9"}, **common),
    )
    shutil.rmtree(tmp_path / "a")
    shutil.rmtree(tmp_path / "b")
    run = read_run(tmp_path / "c")
    found = repetition(run).splitlines()
    assert [re.findall(r"--(?:set|from|checkpoint-every) \S+", one) for one in found] == [
        ["--set network.jitter=0.01", "--checkpoint-every 1"],
        ["--from c-until-1@1", "--set network.jitter=0.01", "--set network.loss=0.5", "--checkpoint-every 2"],
        ["--from c-until-2@2", "--set network.jitter=0.01", "--set network.loss=0.9"],
    ]
    assert [row for row in parameters(run).rows if row[0].startswith("network")] == [
        ("network.jitter", "0.01", "--set until 1 s"),
        ("network.jitter", "0.01", "--set until 2 s"),
        ("network.loss", "0.5", "--set until 2 s"),
        ("network.jitter", "0.01", "--set from 2 s on"),
        ("network.loss", "0.9", "--set from 2 s on"),
    ]
    again = tmp_path / "again"
    again.mkdir()
    monkeypatch.chdir(again)
    for one in found:
        words = shlex.split(one)[1:]
        words += [] if "-o" in words else ["-o", "repeated"]
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.stderr
    assert compare(tmp_path / "c", again / "repeated").equal
    assert compare(tmp_path / "c", again / "repeated").causes == {}
    plain = simulate(
        system,
        RunOptions(out=tmp_path / "plain", overrides={"network.loss": "0.9", "network.jitter": "0.01"}, until=3.0),
    )
    assert plain.packets != json.loads((tmp_path / "c" / "manifest.json").read_text())["packets"]
    assert "settings_before" in " ".join(compare(tmp_path / "c", tmp_path / "plain").causes)


@pytest.mark.usefixtures("without_figures")
def test_the_command_repeats_what_a_person_did(run: Path, tmp_path: Path) -> None:
    """Clicks, and with them the values set; an own step, patterns, a variant; programs cannot be repeated."""
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["posted"] = [{"time": 3.0, "packet": "fd00"}]
    manifest["gateways"] = {"@page": {"received": 1}, "@gcs": {"received": 3}, "@quiet": {"sent": 2}}
    manifest["recording"] = {"interval": 0.1, "signals": ["*.position*"], "packets": True}
    manifest["variant"] = "calm"
    for one in manifest["instances"].values():
        one |= {"step": 0.0025, "step_by": "--step"}
    copied = tmp_path / "copied"
    shutil.copytree(run, copied)
    (copied / "manifest.json").write_text(json.dumps(manifest))
    found = read_run(copied)
    words = shlex.split(repetition(found))
    assert "--at" not in words
    assert words[words.index("--replay") :] == [
        *("--replay", str(copied), "--step", "0.0025", "--record", "*.position*", "--variant", "calm"),
        *("--seed", "7", "--until", "40"),
    ]
    assert programs(found) == ["@gcs"]
    assert "real programs sent through @gcs are not repeated" in write_report([copied]).read_text(encoding="utf-8")


def instances(count: int, **others: str) -> dict[str, Any]:
    parts = {"vehicle": "Quadrotor.fmu", "agent": "LineAgent.fmu"}
    found = {
        f"drone{i}.{name}": {"fmu": f"/x/{fmu}", "step": 0.01}
        for i in range(1, count + 1)
        for name, fmu in parts.items()
    }
    return found | {name: {"fmu": fmu, "step": 0.1} for name, fmu in others.items()}


def test_equal_drones_are_drawn_once() -> None:
    found = groups(instances(1000, weather="Wind.fmu"))
    assert [(one.title, len(one.members)) for one in found] == [
        ("drone1, drone2, ..., drone1000 (x 1000)", 2),
        ("system", 1),
    ]
    drawing = draw_structure(
        {
            "instances": instances(1000),
            "packets": {"sent": 3},
            "network": {"topology": "nearest", "latency": 0.02, "loss": 0.1, "range": "INF", "outages": [1]},
        }
    )
    texts = ["".join(one.itertext()) for one in etree.fromstring(drawing).iter("{*}text")]
    assert texts == [
        *("drone1, drone2, ..., drone1000 (x 1000)", "agent", "LineAgent.fmu, 0.01 s", "vehicle"),
        *("Quadrotor.fmu, 0.01 s", "radio", "nearest, latency 0.02 s, loss 0.1, 1 outages"),
    ]


def test_many_different_parts_are_counted() -> None:
    drawing = draw_structure({"instances": {f"s{i}.a": {"fmu": f"F{i}.fmu", "step": 1.0} for i in range(30)}})
    assert "and 18 other systems" in drawing and "radio" not in drawing.split("</style>")[1]


def test_runs_are_compared(run: Path, tmp_path: Path) -> None:
    other = consensus_run(tmp_path / "other", last_step=6, epsilon=0.25)
    first, inputs, signals = differences([read_run(run), read_run(other)])
    assert first.head == ("", "flown", "other") and ("simulated", "40 s", "- s") in first.rows
    assert (
        inputs.note == "The recordings differ."
        and ("drone2.agent.epsilon", "0.3333333333333333", "0.25") in inputs.rows
    )
    assert any(row[0] == "drone3.agent.target" for row in signals.rows)
    same = differences([read_run(run), read_run(run)])
    assert same[1].note == "The recordings are equal." and not same[1].rows


def test_text_of_strangers_stays_text(evil: Path) -> None:
    text = evil.read_text(encoding="utf-8")
    assert "<script" not in text and "<img src=x" not in text and "\u2028" not in text
    assert "&lt;script&gt;windowhacked=1&lt;/script&gt;" in text
    assert re.search(r"content=\"default-src 'none'; style-src 'sha256-[^']+'; img-src data:;", text)
    assert EVIL.replace(".", "")[:20] in lxml_html.parse(evil).getroot().text_content()


def test_a_browser_shows_it_without_a_network(written: Path, evil: Path, browser: Any) -> None:
    for file in (written, evil):
        page = browser.new_page()
        said: list[str] = []
        asked: list[str] = []
        page.on("console", lambda message, said=said: said.append(message.text))
        page.on("request", lambda request, asked=asked: asked.append(request.url))
        page.goto(file.as_uri())
        page.wait_for_function("[...document.images].every(image => image.complete)")
        assert page.evaluate("[...document.images].filter(image => image.naturalWidth === 0).length") == 0
        assert page.evaluate("window.hacked === undefined && getComputedStyle(document.body).maxWidth") == "1216px"
        assert not said and [url for url in asked if not url.startswith("data:")] == [file.as_uri()]


def tank(folder: Path) -> Path:
    folder.mkdir(parents=True)
    pq.write_table(pa.table({"time": [0.0], "tank.level": [1.0]}), folder / "signals.parquet")
    (folder / "manifest.json").write_text('{"outcome": "failed", "error": "tank: <b>", "instances": {}}')
    return folder


def test_runs_without_vehicles_have_a_report(tmp_path: Path) -> None:
    first, second = tank(tmp_path / "a"), tank(tmp_path / "b")
    text = write_report([first, second], tmp_path / "new" / "both.html").read_text()
    assert text.count("recorded no positions of vehicles") == 2 and text.count("badge failure") == 2
    assert "2 runs compared" in text and "tank: &lt;b&gt;" in text and "The recordings are equal." in text


def test_a_name_beside_a_long_text_is_not_broken() -> None:
    """A column of names was as narrow as the text beside it liked: drone3.vehi, and cle below."""
    row, digest = ("drone3.vehicle", "it has never left the ground: " * 9), ("digest", "0" * 64)
    rows = [line for line in markup.table(Table("t", ("who", "what"), [row, digest])) if "<td" in line]
    assert rows[0].startswith('<tr><td class="name">drone3.vehicle</td><td>it has')
    assert rows[1] == f'<tr><td class="name">digest</td><td>{"0" * 64}</td></tr>'


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("instances", None, "instances is null, not an object"),
        ("instances", {"a": {"parameters": {"x": [1]}}}, "TypeError('a.x is [1], not a value')"),
        ("instances", {"a": {"parameters": 3}}, "TypeError(\"'int' object is not iterable\")"),
        ("notes", 3, "notes is 3, not an array"),
        ("notes", ["text", True], "a note is true, not a text"),
        ("fmus", [], "fmus is [], not an object"),
        (
            "fmus",
            {"a": {"verdicts": {"y": {"is": "Rotors", "count": []}}}},
            "TypeError('count is [], not a text or a number')",
        ),
    ],
)
def test_a_damaged_manifest_is_refused(run: Path, tmp_path: Path, name: str, value: Any, told: str) -> None:
    shutil.copytree(run, tmp_path / "run")
    file = tmp_path / "run" / "manifest.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), name: value}))
    message = re.escape(f"{file}: not the manifest of a complete run: {told}")
    with pytest.raises(SystemDescriptionError, match=message):
        write_report([tmp_path / "run"], tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


def test_damaged_signals_are_refused(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    file = tmp_path / "run" / "signals.parquet"
    data = file.read_bytes()
    columns = len(data) - 8 - int.from_bytes(data[-8:-4], "little")  # then the footer, its length and a mark
    file.write_bytes(data[:4] + b"\xff" * (columns - 4) + data[columns:])
    with pytest.raises(
        SystemDescriptionError, match=re.escape(f"{file}: damaged since it was written; run the system")
    ):
        write_report([tmp_path / "run"], tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


def test_folders_without_a_run_or_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(CosimError, match=r"not the folder of a run: it has no manifest\.json"):
        write_report([tmp_path])
    run = tank(tmp_path / "a")
    with pytest.raises(CosimError, match="the report cannot be written"):
        write_report([run], run / "manifest.json" / "x.html")
    (run / "signals.parquet").write_bytes(b"")
    with pytest.raises(CosimError, match=r"signals\.parquet: not a complete Parquet file"):
        write_report([run])
    (run / "signals.parquet").unlink()
    with pytest.raises(CosimError, match=r"not the folder of a run: it has no signals\.parquet"):
        write_report([run])
