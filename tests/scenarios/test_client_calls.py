"""`benchmarks.clients`: outcomes are read, compared and documented; the recorded ones are those of all calls."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import clients
from benchmarks.clients import differing, documented, read

THEIRS = {"action.arm": "SUCCESS", "action.reboot": "SUCCESS", "tune.play_tune": "SUCCESS"}


def test_calls_that_are_made_again_are_numbered(tmp_path: Path) -> None:
    rows = [("land", "LAND"), ("arm", "ARMED"), ("land", "")]
    (tmp_path / "file").write_text("".join(json.dumps({"call": a, "outcome": b}) + "\n" for a, b in rows))
    assert read(tmp_path / "file") == {"land": "LAND", "arm": "ARMED", "land (2)": ""}


def test_different_and_missing_outcomes_are_told() -> None:
    ours = {"action.arm": "SUCCESS", "action.reboot": "UNSUPPORTED", "gripper.grab": "FAILED"}
    found = differing(ours, THEIRS)
    assert found == [
        ("action.reboot", "UNSUPPORTED", "SUCCESS"),
        ("tune.play_tune", "-", "SUCCESS"),
        ("gripper.grab", "FAILED", "-"),
    ]
    lines = documented({"mavsdk": (3, found[:1]), "mavproxy": (2, [])})
    assert lines == [
        "MAVSDK: 2 of 3 outcomes are equal.",
        "",
        "| call | ours | ArduCopter |",
        "|---|---|---|",
        "| `action.reboot` | UNSUPPORTED | SUCCESS |",
        "",
        "MAVProxy: 2 of 2 outcomes are equal.",
    ]


def test_the_recorded_outcomes_are_compared_without_arducopter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARDUPILOT_SITL", raising=False)
    (tmp_path / "recorded").write_text(json.dumps({"mavsdk": THEIRS}))
    monkeypatch.setattr(clients, "RECORDED", tmp_path / "recorded")
    monkeypatch.setattr(clients, "outcomes_of", lambda vehicle, client: {**THEIRS, "action.arm": f"{vehicle} {client}"})
    clients.main(["--clients", "mavsdk", "--json", str(tmp_path / "json")])
    assert "2 of 3 outcomes equal those of the recorded one" in capsys.readouterr().out
    written = json.loads((tmp_path / "json").read_text())
    assert written["differ"] == {"mavsdk": [["action.arm", "ours mavsdk", "SUCCESS"]]}


def test_the_recorded_outcomes_are_of_all_plugins_and_of_flights() -> None:
    kept = json.loads(clients.RECORDED.read_text())
    assert set(kept) == set(clients.CLIENTS)
    plugins = {call.partition(".")[0] for call in kept["mavsdk"] if not call.startswith("(")}
    assert {
        "action",
        "calibration",
        "ftp",
        "geofence",
        "mission",
        "mission_raw",
        "offboard",
        "param",
        "shell",
    } < plugins
    assert kept["mavsdk"]["(up (first flight))"] == kept["mavsdk"]["(disarmed after the mission)"] == "reached"
    assert "DO_SET_MODE FAILED" in kept["mavproxy"]["mode AUTOTUNE"]
