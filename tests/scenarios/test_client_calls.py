"""`benchmarks.clients`: outcomes are read, compared and documented; the recorded ones are those of all calls."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
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


VEHICLE = """
import socket, sys, time
print("compiling", flush=True)
time.sleep({compiles})
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
    while {lives}:
        one.sendto(b"packet", ("127.0.0.1", int(sys.argv[1])))
        time.sleep(0.05)
sys.exit(3)
"""


def vehicle(monkeypatch: pytest.MonkeyPatch, compiles: float, lives: bool) -> None:
    """Takes a program that sends after a while for the vehicle."""
    code = VEHICLE.format(compiles=compiles, lives=lives)
    monkeypatch.setattr(clients, "ours", lambda folder, port: [sys.executable, "-c", code, str(port)])


def test_a_client_is_started_when_its_vehicle_sends(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    vehicle(monkeypatch, compiles=1.0, lives=True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    began = time.monotonic()
    monkeypatch.setattr(clients, "called", lambda *_: {"after": time.monotonic() - began})
    assert 1.0 <= float(clients.outcomes_of("ours", "mavsdk")["after"]) < 60.0
    assert list(tmp_path.iterdir()) == []


def test_a_vehicle_that_ends_is_told_with_its_log(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    vehicle(monkeypatch, compiles=0.0, lives=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(SystemExit, match=r"(?s)mavsdk with ours: the vehicle has ended with 3 .*compiling"):
        clients.outcomes_of("ours", "mavsdk")
    (folder,) = tmp_path.iterdir()
    assert (folder / "vehicle.log").read_text() == "compiling\n"


def test_the_logs_of_a_client_that_fails_are_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    vehicle(monkeypatch, compiles=0.0, lives=True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(clients, "HERE", tmp_path / "nowhere")
    with pytest.raises(SystemExit, match=r"(?s)returned non-zero exit status 2\.?; its files are in .*can't open file"):
        clients.outcomes_of("ours", "mavsdk")
    (folder,) = tmp_path.iterdir()
    assert "clients_mavsdk.py" in (folder / "client.log").read_text()


def test_a_silent_vehicle_is_not_waited_for_without_end() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        with pytest.raises(RuntimeError, match=r"has sent nothing for 0\.5 s"):
            clients.await_packet(clients.free_port(), process, patience=0.5)
        process.kill()
