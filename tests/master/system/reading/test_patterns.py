"""Patterns of names, and values set by them: `[2]` is an index, and a pattern that sets nothing is an error."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.diagnostics.names import is_pattern, matching, near_pattern
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.changes import changes
from cosim_master.system.settings.time_grid import time_grid
from tests.master.conftest import variable
from tests.master.fmus.strict import ABLE

pytestmark = pytest.mark.usefixtures("own_cache")

NAMES = ["drone1.v.wind[1]", "drone1.v.wind[2]", "drone2.v.wind[2]", "drone10.v.wind[2]", "mast.wind[2]", "mast.{a,b}"]


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("drone*.wind[2]", ["drone1.v.wind[2]", "drone2.v.wind[2]", "drone10.v.wind[2]"]),
        ("drone?.v.wind[2]", ["drone1.v.wind[2]", "drone2.v.wind[2]"]),
        ("*wind[12]", []),
        ("mast.{a,b}", ["mast.{a,b}"]),
        ("mast.{a,*}", ["mast.{a,b}"]),
        ("Drone*", []),
        ("*[!1]", []),
        ("*", NAMES),
    ],
)
def test_star_and_question_mark_only(pattern: str, found: list[str]) -> None:
    assert matching(pattern, NAMES) == found


def test_which_texts_are_patterns() -> None:
    assert [is_pattern(text) for text in ("a.b[2]", "a*", "a?", "{a,b}")] == [False, True, True, False]


def test_near_patterns_take_the_names_of_a_swarm_together() -> None:
    swarm = [f"drone{n}.vehicle.wind[{i}]" for n in range(1, 61) for i in (1, 2, 3)] + ["mast.vehicle.gust"]
    assert near_pattern("drone*.vehicle.windd[2]", swarm).startswith('did you mean "drone*.vehicle.wind[2]" or "')
    assert near_pattern("mast.*.gusty", swarm) == 'did you mean "mast.vehicle.gust"?'


@pytest.fixture
def three(workshop: Any, variable: Any) -> Any:
    """Checks d1, d2 and d3, each a vehicle with wind, mass and a position, and a mast with wind alone."""
    wind = [variable(f"wind[{i}]", start="0", variability="continuous") for i in (1, 2, 3)]
    mass = variable("mass", "parameter", start="1", variability="tunable", min="0")
    workshop.fmu("vehicle.fmu", *wind, mass, variable("position[2]", "output"), step="0.5")
    workshop.fmu("mast.fmu", *wind, step="0.5")
    parts = "".join(
        workshop.system(workshop.component("vehicle", "vehicle.fmu"), name=f"d{n}") for n in (1, 2, 3)
    ) + workshop.component("mast", "mast.fmu")
    path = workshop.ssd("s.ssd", workshop.system(parts), '<ssd:DefaultExperiment stopTime="2"/>')

    def checked(overrides: dict[str, str] | None = None) -> CheckedSystem:
        return check(read_system(path), overrides)

    return checked


def starts(checked: CheckedSystem) -> dict[str, Any]:
    return {
        f"{instance.name}.{name}": value
        for instance in checked.instances
        for name, value in instance.start_values.items()
    }


def refusal(call: Any, *arguments: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        call(*arguments)
    return str(caught.value)


def test_a_pattern_sets_all_it_matches(three: Any) -> None:
    assert starts(three({"d*.vehicle.wind[2]": "5", "d?.vehicle.mass": "2"})) == {
        f"d{n}.vehicle.{name}": value for n in (1, 2, 3) for name, value in (("wind[2]", 5.0), ("mass", 2.0))
    }
    assert starts(three({"*wind[1]": "1"})).keys() == {
        *(f"d{n}.vehicle.wind[1]" for n in (1, 2, 3)),
        "mast.wind[1]",
    }


def test_the_later_one_wins(three: Any) -> None:
    assert starts(three({"d*.vehicle.mass": "2", "d2.vehicle.mass": "3"}))["d2.vehicle.mass"] == 3.0
    assert starts(three({"d2.vehicle.mass": "3", "d*.vehicle.mass": "2"}))["d2.vehicle.mass"] == 2.0


@pytest.mark.parametrize(
    ("pattern", "text", "message"),
    [
        ("d*.vehicle.windd[2]", "1", '--set: "d*.vehicle.windd[2]" matches no variable; did you mean "d*.vehicle.wind'),
        ("d*.vehicle.mass", "-1", '--set: "d*.vehicle.mass" is set to -1, which is outside of its range'),
        ("d*.vehicle.mass", "big", '--set: d*.vehicle.mass: "big" is not of its type; valid: a number'),
        (
            "d?.vehicle.*[2]",
            "1",
            '--set: "d?.vehicle.*[2]" matches 6 variables, and 3 of them cannot be set: each is a continuous output '
            '(initial="calculated"); only inputs and variables with a start value can be: '
            "d1.vehicle.position[2], d2.vehicle.position[2], d3.vehicle.position[2]",
        ),
    ],
)
def test_patterns_that_cannot_be_applied(three: Any, pattern: str, text: str, message: str) -> None:
    found = refusal(three, {pattern: text})
    assert message in found
    assert "\n" not in found


def test_changes_by_pattern(three: Any) -> None:
    checked = three()
    clock = time_grid(checked, None, None)
    made = changes(checked, clock, [(0.5, "d*.vehicle.wind[2]", "4")])
    assert [(c.k, checked.instances[c.instance].name, c.variable.name, c.value) for c in made] == [
        (1, f"d{n}.vehicle", "wind[2]", 4.0) for n in (1, 2, 3)
    ]


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("x*.wind[2]", "--at 0.5 x*.wind[2]=4: it matches no variable; "),
        (
            "d*[2]",
            "it matches 6 variables, one of them d1.vehicle.position[2]: it is a continuous output; only tunable",
        ),
        ("network.loss", "settings of radio, recording and master cannot change during a run; give them by --set"),
    ],
)
def test_changes_that_cannot_be_made(three: Any, pattern: str, message: str) -> None:
    checked = three()
    assert message in refusal(changes, checked, time_grid(checked, None, None), [(0.5, pattern, "4")])


def test_a_run_with_settings_says_them_in_its_manifest(stricts: Any, tmp_path: Path) -> None:
    """y of a and b integrates u: 1 for 2 s; rows every second, since the run says so."""
    stricts.fmu()
    system = stricts.ssd(stricts.component("a", p=1.0) + stricts.component("b", p=1.0), stop=2.0)
    given = {"?.u": "1", "recording.interval": "1", "recording.signals": "*.y", "network.loss": "0.25"}
    result = simulate(system, RunOptions(out=tmp_path / "out", overrides=given))
    assert (result.outcome, stricts.complaints) == ("done", [])
    rows = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert rows == {"time": [0.0, 1.0, 2.0], "a.y": [0.0, 1.0, 2.0], "b.y": [0.0, 1.0, 2.0]}
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["settings"] == {"recording": {"interval": "1", "signals": "*.y"}, "network": {"loss": "0.25"}}
    assert manifest["network"]["loss"] == 0.25
    assert manifest["recording"] == {"interval": 1.0, "signals": ["*.y"], "packets": True}


def test_settings_of_the_recording_that_are_wrong(stricts: Any) -> None:
    stricts.fmu()
    system = stricts.ssd(stricts.component("a"), stop=2.0)

    def run(**given: str) -> None:
        simulate(system, RunOptions(overrides={name.replace("_", "."): text for name, text in given.items()}))

    assert refusal(lambda: run(recording_intervall="1")).startswith(
        '--set: there is no setting "recording.intervall"; did you mean "recording.interval"?'
    )
    assert "--set: recording.packets=maybe: valid are true, false" in refusal(lambda: run(recording_packets="maybe"))


def test_all_is_recorded_of_a_system_that_has_no_outputs(stricts: Any, tmp_path: Path) -> None:
    """A sink with one input: `*` is not wrong there, other patterns are."""
    whole = stricts.fmu("whole.fmu")
    text = stricts.workshop.description([variable("u").replace("'@'", '"0"')], step=0.5, flags=ABLE)
    with zipfile.ZipFile(whole) as origin, zipfile.ZipFile(whole.with_name("strict.fmu"), "w") as sink:
        for name in origin.namelist():
            content = (
                text.replace('guid="{0}"', 'guid="strict"') if name == "modelDescription.xml" else origin.read(name)
            )
            sink.writestr(name, content)
    system = stricts.ssd(
        '<ssd:Component name="a" type="application/x-fmu-sharedlibrary" source="strict.fmu"/>', stop=1.0
    )
    result = simulate(system, RunOptions(out=tmp_path / "out", record=("*",)))
    assert result.outcome == "done"
    assert pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict() == {"time": [0.0, 0.5, 1.0]}
    found = refusal(lambda: simulate(system, RunOptions(record=("a.*",))))
    assert found == '--record: "a.*" matches no output or local variable: the system has none'
