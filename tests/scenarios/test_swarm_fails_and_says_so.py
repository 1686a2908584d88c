"""Swarms that fail say so: in the findings of a run, in its manifest and in its last lines. Good ones say nothing."""

from __future__ import annotations

import json
import re
import shutil
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.swarm.new import new_system
from cosim_master.verdict.findings import Finding
from tests.scenarios.flights import SYSTEMS

FAILING = {
    "drone2.autopilot.SYSID_THISMAV": "102",
    "drone2.agent.timeout": "5",
    "drone3.autopilot.BATT_ARM_VOLT": "99",
    "drone4.vehicle.mass": "50",
    "drone5.vehicle.wind[1]": "60",
    "drone6.agent.origin_latitude": "-35.363262",
    "drone7.autopilot.estimate_ready_time": "1000",
    "drone9.vehicle.position_start[2]": "300",
    "drone10.vehicle.position_start[2]": "300",
}
"""Of a line of ten drones: what is wrong with whom. The motors of drone 8 fail at 26 s."""


@pytest.fixture(scope="module")
def line(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Makes lines of drones: how many, and pairs (file, old text, new text) of changes."""
    folder = tmp_path_factory.mktemp("lines")

    def make(drones: int, *changes: tuple[str, str, str], shape: str = "line", until: float = 30.0) -> Path:
        made = new_system(shape, drones, folder / f"{shape}{len([*folder.iterdir()])}", fmus=fmus, until=until)
        for file, old, new in changes:
            text = (made / file).read_text(encoding="utf-8")
            changed = re.sub(old, new, text)
            assert changed != text, (file, old)
            (made / file).write_text(changed, encoding="utf-8")
        return made

    return make


class Run:
    """A run that is done, its findings and its manifest."""

    def __init__(self, system: Path, out: Path, **options: Any) -> None:
        self.system = system
        result = simulate(system, RunOptions(out=out, **options))
        assert result.outcome == "done"
        assert result.verdict is not None
        self.verdict = result.verdict
        self.written = json.loads((out / "manifest.json").read_text(encoding="utf-8"))["verdict"]

    def of(self, kind: str) -> dict[str, Finding]:
        """The findings of a kind by the first that they are about; all of them are in the manifest, too."""
        found = [finding for finding in self.verdict.findings if finding.kind == kind]
        assert [finding.as_json() for finding in found] == [
            one for one in self.written["findings"] if one["kind"] == kind
        ]
        return {"".join(finding.who[:1]): finding for finding in found}


@pytest.fixture(scope="module")
def failing(line: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A line of ten in which seven fail, each in its own way."""
    weak = [(26.0, "drone8.autopilot.MOT_SPIN_MAX", "0.3")]
    return Run(line(10), tmp_path_factory.mktemp("failing"), overrides=FAILING, at=weak, until=32.0)


def test_agent_whose_autopilot_has_another_system_id_fails(failing: Run) -> None:
    found = failing.of("agent failed")["drone2.agent"]
    assert found.severity == "failure"
    assert found.time == pytest.approx(5.0, abs=0.2)
    assert found.numbers == {"state": "failed", "reason": 1}
    assert "no HEARTBEAT of its autopilot: both need the same system id (failure: no_heartbeat)" in found.text
    assert failing.of("different system ids")["drone2.agent.sysid"].text.startswith(
        "drone2.agent.sysid = 2, drone2.autopilot.SYSID_THISMAV = 102: on board of one vehicle"
    )


def test_drone_that_does_not_arm_never_flies_and_its_agent_is_late(failing: Run) -> None:
    found = failing.of("never flew")["drone3.vehicle"]
    assert found.time == pytest.approx(2.2, abs=0.2)
    assert found.text == (
        "drone3.vehicle has never left the ground, though drone3.agent wanted it to from 2.2 s on: is it armed, "
        "are its motors strong enough for its mass, and can it fly at all (a rover cannot)?"
    )
    late = failing.of("agent late")["drone3.agent"]
    assert late.numbers == {"state": "arming", "by": 25.0}
    assert late.text == (
        "drone3.agent is still in state arming at 32.0 s; it was to work from 25 s on (first_step_time)"
    )


def test_drone_that_is_too_heavy_never_flies(failing: Run) -> None:
    assert failing.of("never flew").keys() == {"drone3.vehicle", "drone4.vehicle"}
    assert failing.of("agent late")["drone4.agent"].numbers["state"] == "takeoff"


def test_drone_in_too_strong_a_wind_is_off_course(failing: Run) -> None:
    found = failing.of("off course")["drone5.vehicle"]
    assert found.severity == "failure"
    assert found.numbers["distance"] > 10.0
    assert "from where drone5.autopilot wanted it, more than 5 m from" in found.text


def test_angle_in_degrees_is_told_with_the_value_that_was_meant(failing: Run) -> None:
    found = failing.of("degrees for radians")["drone6.agent.origin_latitude"]
    assert found.severity == "warning"
    assert found.time is None
    assert found.text == (
        "--set: drone6.agent.origin_latitude is -35.3633 rad, more than a full turn; "
        "did you mean -0.617205 (= -35.3633 degrees)?"
    )


def test_drone_without_position_estimate_is_late(failing: Run) -> None:
    assert failing.of("agent late")["drone7.agent"].numbers["state"] == "estimate"
    assert "drone7.vehicle" not in failing.of("never flew")  # nobody wanted it to fly yet


def test_drone_whose_motors_become_too_weak_comes_down(failing: Run) -> None:
    found = failing.of("came down")["drone8.vehicle"]
    assert 26.0 < float(found.time or 0.0) < 29.0
    assert found.text.endswith("though it had flown and drone8.agent wants it in the air: are its motors too weak?")
    assert "drone1.vehicle" not in failing.of("came down")


def test_drone_that_stands_on_another_touches_it(failing: Run) -> None:
    found = failing.of("contact")["drone9.vehicle"]
    assert found.who == ("drone9.vehicle", "drone10.vehicle")
    assert (found.time, found.numbers["distance"]) == (0.0, 0.0)
    assert failing.written["nearest"] == {"who": ["drone9.vehicle", "drone10.vehicle"], "distance": 0.0, "time": 0.0}


def test_neighbours_of_those_that_fail_hear_them_no_more(failing: Run) -> None:
    """Autopilots without position send none: drones 6 and 8 wait for drone 7's; drones 1 and 3 for drone 2's."""
    stale = failing.of("out of bounds")
    assert {"drone1.agent", "drone6.agent", "drone8.agent"} <= stale.keys()
    assert "its right neighbour is not heard" in stale["drone1.agent"].text
    assert "(right_age outside of 0 to stale_time = 1 s from 25.1 s on)" in stale["drone1.agent"].text


def test_manifest_counts_what_the_run_says(failing: Run) -> None:
    kinds = [finding["severity"] for finding in failing.written["findings"]]
    counts = {"failures": kinds.count("failure"), "warnings": kinds.count("warning"), "notes": kinds.count("note")}
    assert {name: failing.written[name] for name in counts} == counts
    assert failing.written["good"] is False
    assert (failing.written["from"], failing.written["to"]) == (0.0, 32.0)
    assert kinds == sorted(kinds, key=["failure", "warning", "note"].index)


def test_radio_that_loses_drones_leaves_stale_neighbours(line: Callable[..., Path], tmp_path: Path) -> None:
    """Drone 3 is out from 26 s to 29 s, drone 5 has no link, and drones 1 and 3 have one system id."""
    network = ('(<link between="drone4 drone5"/>)', '<outage node="drone3" start="26" stop="29"/>')
    run = Run(
        line(5, ("SystemStructure.ssd", *network)),
        tmp_path,
        overrides={"drone3.autopilot.SYSID_THISMAV": "1", "drone3.agent.sysid": "1"},
        until=31.0,
    )
    assert run.of("cut off")["drone5"].text == (
        'no <link> leads to drone5, and topology="listed": it can neither hear nor reach another node'
    )
    twice = run.of("system id used twice")["drone1"]
    assert twice.who == ("drone1", "drone3")
    assert twice.text == "drone2 hears drone1, drone3, all with system id 1; give each an id of its own"
    stale = run.of("out of bounds")
    assert "first at 26.9 s" in stale["drone3.agent"].text or "from 25.1 s on" in stale["drone3.agent"].text
    assert "its left neighbour is not heard" in stale["drone5.agent"].text


def test_neighbour_that_is_silent_for_a_while_is_told_with_the_time(line: Callable[..., Path], tmp_path: Path) -> None:
    network = ('(<link between="drone2 drone3"/>)', r'\1<outage node="drone3" start="26" stop="29"/>')
    run = Run(line(3, ("SystemStructure.ssd", *network)), tmp_path, until=32.0)
    found = run.of("out of bounds")["drone2.agent"]
    assert run.of("out of bounds").keys() == {"drone2.agent", "drone3.agent"}
    assert found.severity == "warning"
    assert float(found.time or 0.0) == pytest.approx(27.0, abs=0.35)
    assert float(found.numbers["total"]) == pytest.approx(2.2, abs=0.35)


def test_radio_that_loses_everything(line: Callable[..., Path], tmp_path: Path) -> None:
    run = Run(line(3, ("SystemStructure.ssd", 'latency="0.02"', 'latency="0.02" loss="1"')), tmp_path, until=27.0)
    found = run.of("no radio")[""]
    assert re.fullmatch(r"none of the (\d+) packets sent by radio has reached a node \(\1 lost: channel\)", found.text)
    assert run.of("out of bounds").keys() == {"drone1.agent", "drone2.agent", "drone3.agent"}


@pytest.fixture(scope="module")
def undriven(line: Callable[..., Path]) -> Path:
    """Three drones whose motors are not connected."""
    return line(3, ("drone.ssd", r'<ssd:Connection [^>]*endConnector="motor\[\d\]"/>', ""))


def test_input_that_nothing_drives(undriven: Path, tmp_path: Path) -> None:
    run = Run(undriven, tmp_path, until=14.0)
    found = run.of("open input")["drone1.vehicle.motor[1]"]
    assert found.severity == "warning"
    assert len(found.who) == 24
    assert found.text == (
        "nothing drives drone1.vehicle.motor, drone2.vehicle.motor, drone3.vehicle.motor (8 elements), and the system "
        "does not set it: it stays at its start value 0; connect it or set a value"
    )
    assert len(run.of("never flew")) == 3


def test_gateway_that_nothing_crosses(line: Callable[..., Path], tmp_path: Path) -> None:
    run = Run(line(3), tmp_path, until=0.5, gcs=["tcp:0"])
    assert run.of("silent gateway")["@gcs"].text.startswith("nothing has crossed @gcs (tcp:127.0.0.1:")


def test_gateway_that_nobody_listens_to(line: Callable[..., Path], tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:  # so that nobody else listens there
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        taken.connect(("127.0.0.1", 9))  # and what comes from elsewhere is refused
        run = Run(line(3), tmp_path, until=2.0, gcs=[f"udpout:127.0.0.1:{port}"])
    text = run.of("silent gateway")["@gcs"].text
    assert re.fullmatch(
        rf"\d+ of \d+ packets were refused at @gcs \(udpout:127\.0\.0\.1:{port}\), and none came from it: "
        r"does a program listen there\?",
        text,
    )


def test_gateway_that_somebody_only_listens_to(line: Callable[..., Path], tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ears:
        ears.bind(("127.0.0.1", 0))
        run = Run(line(3), tmp_path, until=2.0, gcs=[f"udpout:127.0.0.1:{ears.getsockname()[1]}"])
    assert run.of("silent gateway") == {}


# ---- the command ---------------------------------------------------------------------------------------------------


def test_last_lines_say_what_went_wrong(undriven: Path, tmp_path: Path) -> None:
    out = ["-o", str(tmp_path / "run"), "--until", "13"]
    said = CliRunner().invoke(app, ["run", str(undriven), *out])
    assert said.exit_code == 0
    assert said.stdout.startswith("done, 4 findings (3 never flew, 1 open input): 13 s simulated in ")
    table = [line.split() for line in said.stderr.splitlines() if "drone2.vehicle" in line]
    assert table[0][:5] == ["failure", "2.2", "never", "flew", "drone2.vehicle"]
    assert table[1][:3] == ["warning", "open", "input"]
    quiet = CliRunner().invoke(app, ["-q", "run", str(undriven), *out, "--strict"])
    assert (quiet.exit_code, quiet.stdout) == (1, "")
    assert "drone3.vehicle has never left the ground" in quiet.stderr


def test_packets_that_have_not_arrived_at_the_end_are_counted(tmp_path: Path) -> None:
    late = ["--set", "network.latency=30", "--until", "10", "-o", str(tmp_path / "run")]
    said = CliRunner().invoke(app, ["run", str(SYSTEMS / "line5"), *late])
    assert said.exit_code == 0
    (line,) = (one for one in said.stdout.splitlines() if one.startswith("packets: "))
    found = re.fullmatch(r"packets: (\d+) sent, 0 delivered, 0 lost, (\d+) still in flight", line)
    assert found is not None and found[1] == found[2] != "0"


def test_check_tells_what_is_known_before(undriven: Path) -> None:
    arguments = ["check", str(undriven), "--set", "drone1.vehicle.yaw_start=90"]
    said = CliRunner().invoke(app, arguments)
    assert said.exit_code == 0
    assert "no problems, 2 findings (1 open input, 1 degrees for radians)" in said.stdout
    assert "did you mean 1.5708 (= 90 degrees)?" in said.stderr
    assert CliRunner().invoke(app, [*arguments, "--strict"]).exit_code == 1


# ---- good swarms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("system", "until"), [("line5", 85.0), ("line5-ends", 60.0), ("line5-hexa", 40.0), ("line5-estimated", 60.0)]
)
def test_good_system_says_nothing(system: str, until: float, fmus: Path, tmp_path: Path) -> None:
    assert fmus.is_dir()
    out = ["-o", str(tmp_path / "run"), "--until", str(until), "--strict", "--record", "*.position[1]"]
    said = CliRunner().invoke(app, ["run", str(SYSTEMS / system), *out])
    assert said.exit_code == 0
    assert said.stdout.startswith("done: ")
    assert "finding" not in said.output
    verdict = json.loads((tmp_path / "run" / "manifest.json").read_text(encoding="utf-8"))["verdict"]
    assert verdict["findings"] == []
    assert verdict["nearest"]["distance"] == pytest.approx(0.0 if system == "line5-ends" else 10.0, abs=1.0)
    assert CliRunner().invoke(app, ["check", str(SYSTEMS / system), "--strict"]).exit_code == 0


@pytest.mark.parametrize(("shape", "drones", "until"), [("line", 20, 32.0), ("grid", 12, 32.0), ("line", 260, 0.5)])
def test_good_new_system_says_nothing(
    shape: str, drones: int, until: float, line: Callable[..., Path], tmp_path: Path
) -> None:
    """With 260 drones system ids repeat, out of earshot."""
    run = Run(line(drones, shape=shape), tmp_path, until=until, record=["drone1.vehicle.*"])
    assert run.verdict.findings == ()
    assert run.verdict.good


def test_branch_is_judged_with_what_was_before_it(line: Callable[..., Path], tmp_path: Path) -> None:
    system = line(3)
    Run(system, tmp_path / "run", until=30.0, checkpoint_every=20.0, record=["*.position*"])
    heavy = Run(
        system, tmp_path / "branch", origin=f"{tmp_path / 'run'}@20", overrides={"drone2.autopilot.MOT_SPIN_MAX": "0.3"}
    )
    assert (heavy.written["from"], heavy.written["to"]) == (0.0, 30.0)
    assert [(finding.kind, finding.who) for finding in heavy.verdict.findings] == [("came down", ("drone2.vehicle",))]
    shutil.rmtree(tmp_path)


@pytest.mark.parametrize("at", [12.0, 28.0])
def test_run_that_goes_on_is_judged_as_one_that_never_stopped(at: float, failing: Run, tmp_path: Path) -> None:
    """What had failed before the checkpoint counts, and what was under way goes on."""
    weak = [(26.0, "drone8.autopilot.MOT_SPIN_MAX", "0.3")]
    options: dict[str, Any] = {"at": weak, "until": 32.0, "record": ["*.position*"]}
    Run(failing.system, tmp_path / "run", overrides=FAILING, checkpoint_every=at, **options)
    on = Run(failing.system, tmp_path / "on", origin=f"{tmp_path / 'run'}@{at:g}", **options)
    assert on.written == failing.written
    shutil.rmtree(tmp_path)


def test_what_is_watched_does_not_change_a_recording(line: Callable[..., Path], tmp_path: Path) -> None:
    """With limits that nothing meets and with others, recorded or not: the same bytes."""
    annotation = (
        '<ssc:Annotation type="org.uav-cosim.verdict">'
        '<verdict xmlns="https://uav-cosim.org/ns/1" contact="100" deviation="0.01"/></ssc:Annotation>'
        "</ssd:Annotations>"
    )
    system, strict = line(3), line(3, ("SystemStructure.ssd", "</ssd:Annotations>", annotation))
    runs = {}
    for name, one in (("plain", system), ("strict", strict)):
        runs[name] = Run(one, tmp_path / name, until=15.0, record=["*.vehicle.position*"])
    assert runs["plain"].verdict.findings == ()
    assert len(runs["strict"].of("contact")) > 0
    data = [(tmp_path / name / "signals.parquet").read_bytes() for name in runs]
    assert data[0] == data[1]
