"""What the page gets of a recording: read back with numpy, against the recording."""

from __future__ import annotations

import json
import re
import zlib
from base64 import b64decode
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.storage.run_folder import clear
from cosim_master.view.block import Block
from cosim_master.view.curves import thinned
from cosim_master.view.page import write_page
from cosim_master.view.replay import replay
from tests.master.view.recordings import EVIL, evil_run, flying, write_packets, write_run

TIME = np.arange(0, 10.0, 0.0125)
ROTORS = {
    "spin": {"is": "Rotors", "count": "n", "forward": "x", "right": "y", "down": "z", "direction": "turns"},
    "place": {"is": "Position"},
    "way": {"is": "Attitude"},
}


class Page:
    """A page taken apart as a browser does it."""

    def __init__(self, text: str) -> None:
        self.text = text
        held = dict(re.findall(r'<script type="text/plain" id="(\w+)">([^<]*)</script>', text))
        self.run: dict[str, Any] = json.loads(zlib.decompress(b64decode(held["run"])))
        self._block = zlib.decompress(b64decode(held["data"]))

    def array(self, place: tuple[int, str, int]) -> np.ndarray[Any, Any]:
        offset, kind, count = place
        size = int(kind[1])
        planes = np.frombuffer(self._block, np.uint8, count * size, offset).reshape(size, count)
        return np.ascontiguousarray(planes.T).view(f"<{kind}")[:, 0]

    def signal(self, name: str) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Rows and values of a signal."""
        told = next(one for one in self.run["signals"] if one["name"] == name)
        rows = np.cumsum(self.array(told["rows"])) if "rows" in told else np.zeros(1, int)
        return rows, self.array(told["values"]).astype(float) + told.get("origin", 0.0)

    def place(self, vehicle: int, what: str) -> np.ndarray[Any, Any]:
        told = self.run["vehicles"][vehicle]
        origin = np.array(told["origin"][what])
        return self.array(told[what]).astype(float).reshape(len(origin), -1) + origin[:, None]


def page(run: Path) -> Page:
    return Page(write_page(run).read_text(encoding="utf-8"))


def test_positions_and_signals_are_those_recorded(tmp_path: Path) -> None:
    columns = flying(["d1", "d2", "d10"], TIME)
    columns["d1.agent.mode"] = (np.where(TIME < 3, 4, 9).astype(np.int32), "")
    columns["d1.agent.up"] = (TIME > 4, "")
    columns["d2.agent.text"] = (["x" if t < 5 else "y" for t in TIME], "")
    columns["d2.agent.lat"] = (-35.3632620 + 1e-7 * TIME, "deg")
    columns["d2.agent.same"] = (np.full(len(TIME), 7.5), "K")
    shown = page(write_run(tmp_path / "run", columns, items={"d1.agent.mode": {"GUIDED": 4, "LAND": 9}}))
    assert [one["name"] for one in shown.run["vehicles"]] == ["d1", "d2", "d10"]
    frames = shown.array(shown.run["motion"]["frames"])
    assert np.diff(TIME[frames]).max() < 0.026 and frames[0] == 0 and frames[-1] == len(TIME) - 1
    np.testing.assert_allclose(shown.place(2, "position")[0], 2 * TIME[frames], atol=1e-6)
    assert (shown.place(2, "position")[1] == 20.0).all()
    times = shown.run["start"] + np.cumsum(shown.array(shown.run["rows"])) * shown.run["quantum"]
    np.testing.assert_allclose(times, TIME, atol=1e-9)
    rows, values = shown.signal("d1.vehicle.position[1]")
    np.testing.assert_allclose(values, columns["d1.vehicle.position[1]"][0][rows], atol=1e-6)
    rows, values = shown.signal("d1.agent.mode")
    assert (rows.tolist(), values.tolist()) == ([0, 240], [4, 9])
    assert shown.signal("d1.agent.up")[0].tolist() == [0, 321]
    assert shown.signal("d2.agent.same")[1].tolist() == [7.5]
    rows, values = shown.signal("d2.agent.lat")  # single precision alone would be off by 1e-6
    np.testing.assert_allclose(values, columns["d2.agent.lat"][0][rows], rtol=0, atol=1e-12)
    text = next(one for one in shown.run["signals"] if one["name"] == "d2.agent.text")
    assert (text["texts"], shown.signal("d2.agent.text")[0].tolist()) == (["x", "y"], [0, 400])
    mode = next(i for i, one in enumerate(shown.run["signals"]) if one["name"] == "d1.agent.mode")
    assert shown.run["signals"][mode]["items"] == [["GUIDED", 4], ["LAND", 9]]
    assert mode in shown.run["vehicles"][0]["words"]


def test_airframe_and_attitude_are_what_the_fmu_declares(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    columns: dict[str, Any] = {"time": (TIME, "s")}
    columns |= {f"a.place[{i}]": (np.full(len(TIME), 3.0 * i), "m") for i in (1, 2, 3)}
    columns |= {
        f"a.way[{i}]": (np.full(len(TIME), v), "") for i, v in zip((1, 2, 3, 4), (half, 0, 0, half), strict=True)
    }
    columns |= {f"a.spin[{i}]": (100.0 * i * TIME, "rad/s") for i in (1, 2)}
    parameters: dict[str, Any] = {"n": 2}
    for name, values in {"x": (0.1, -0.1, 0), "y": (0.2, -0.2, 0), "z": (0, 0.5, 0), "turns": (1, -1, 0)}.items():
        parameters |= {f"{name}[{i + 1}]": value for i, value in enumerate(values)}
    instances = {"a": {"fmu": "A.fmu", "parameters": parameters}}
    run = write_run(tmp_path / "run", columns, instances=instances, fmus={"A.fmu": {"verdicts": ROTORS}})
    shown = page(run)
    (vehicle,) = shown.run["vehicles"]
    assert vehicle["rotors"] == [[0.1, 0.2, 0, 1], [-0.1, -0.2, 0.5, -1]]
    attitude = shown.array(vehicle["attitude"]).reshape(4, -1) / 32767
    np.testing.assert_allclose(attitude[:, 5], [half, 0, 0, half], atol=2e-5)
    speed = shown.array(vehicle["speed"])
    assert (speed[0], speed[-1]) == (0, 255)  # of the greatest mean
    assert shown.place(0, "position")[:, 0].tolist() == [3, 6, 9]


@pytest.mark.parametrize("wrong", [{"n": 3}, {"n": "two"}, {"x[1]": "NaN"}, {"turns[2]": None}])
def test_a_vehicle_whose_rotors_are_not_known_is_drawn_without(tmp_path: Path, wrong: dict[str, Any]) -> None:
    columns: dict[str, Any] = {"time": (TIME, "s")}
    columns |= {f"a.place[{i}]": (0 * TIME, "m") for i in (1, 2, 3)}
    parameters = {"n": 2, **{f"{name}[{i}]": 1.0 for name in ("x", "y", "z", "turns") for i in (1, 2)}, **wrong}
    instances = {"a": {"fmu": "A.fmu", "parameters": parameters}}
    shown = page(write_run(tmp_path / "run", columns, instances=instances, fmus={"A.fmu": {"verdicts": ROTORS}}))
    assert shown.run["vehicles"][0]["rotors"] is None


def test_numbers_that_json_does_not_have(tmp_path: Path) -> None:
    """Such numbers are recorded by failing models; the manifest of a run that was cut short lacks others."""
    columns = flying(["d"], TIME)
    columns["d.gap"] = (np.where(TIME < 3, np.nan, TIME), "m")
    columns["d.far"] = (np.where(TIME < 3, -1e308, 1e308), "m")
    columns["d.never"] = (np.full(len(TIME), np.inf), "m")
    run = write_run(tmp_path / "run", columns, simulated_s=None, wall_s=None, verdict=None, outcome="failed")
    shown = page(run)
    assert shown.signal("d.far")[1].tolist() == [*[-1e308] * 240, *[1e308] * 560]
    _, values = shown.signal("d.gap")
    assert np.isnan(values[:240]).all() and values[240] == pytest.approx(3.0)
    assert shown.signal("d.never")[1].tolist() == [np.inf]
    assert shown.run["outcome"] == ["failed", "failure"]


def test_desired_positions_and_steps(tmp_path: Path) -> None:
    columns = flying(["d1"], TIME)
    columns |= {f"d1.pilot.want[{i}]": (TIME + i, "m") for i in (1, 2, 3)}
    columns["d1.agent.step"] = (np.floor(TIME / 4).astype(np.int32), "")
    columns["d1.agent.target"] = (np.where(TIME < 8, 5.0, 6.0), "m")
    fmus = {"P.fmu": {"verdicts": {"want": {"is": "DesiredPosition"}}}}
    run = write_run(tmp_path / "run", columns, fmus=fmus, instances={"d1.pilot": {"fmu": "P.fmu", "parameters": {}}})
    shown = page(run)
    frames = shown.array(shown.run["motion"]["frames"])
    np.testing.assert_allclose(shown.place(0, "desired")[2], TIME[frames] + 3, atol=1e-6)
    goal = shown.place(0, "goal")[0]
    assert np.isnan(goal[TIME[frames] < 4]).all()  # before the first step there is none
    assert (goal[(TIME[frames] >= 4) & (TIME[frames] < 8)] == 5.0).all()
    assert shown.run["steps"] == [[1, 4.0], [2, 8.0]]


def test_packets_links_and_log(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", flying(["d1", "d2"], TIME))
    text = ardupilotmega.MAVLink_statustext_message(4, b"Arming motors")
    beats = [ardupilotmega.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3) for _ in range(3)]
    write_packets(
        run,
        [
            (1.0, 1.0, "d1.autopilot", "d1", beats[0], "on board"),
            (1.0, 1.25, "d1.autopilot", "d2", beats[0], "radio"),
            (2.0, -1, "d1.autopilot", "d2", beats[1], "lost: channel"),
            (3.0, 3.75, "d2.autopilot", "d1", text, "radio"),
            (4.0, 4.5, "gcs", "d1", beats[2], "radio"),
        ],
    )
    shown = page(run)
    told = shown.run["traffic"]
    assert [(one["from"], one["to"], one["sent"], one["lost"], one["delay"]) for one in told["links"]] == [
        ("d1", "d2", 2, 1, 0.25),
        ("d2", "d1", 1, 0, 0.75),
        ("gcs", "d1", 1, 0, 0.5),
    ]
    assert told["links"][0]["causes"] == {"lost: channel": 1}
    flights = {name: shown.array(place) for name, place in told["flights"].items()}
    assert np.cumsum(flights["sent"]).tolist() == [1_000_000, 2_000_000, 3_000_000, 4_000_000]
    assert flights["delay"].tolist() == [250_000, 0, 750_000, 500_000]
    assert list(zip(flights["from"], flights["to"], strict=True)) == [(0, 1), (0, 1), (1, 0), (65535, 0)]
    assert flights["lost"].tolist() == [0, 1, 0, 0]
    log = told["log"]
    names = [told["messages"][i] for i in shown.array(log["message"])]
    assert names == ["HEARTBEAT", "HEARTBEAT", "STATUSTEXT", "HEARTBEAT"]
    assert log["texts"][2] == "Arming motors"
    assert log["texts"][0] == "type 2, autopilot 3, base_mode 81, custom_mode 4, system_status 3, mavlink_version 3"
    assert (shown.array(log["heard"]).tolist(), shown.array(log["lost"]).tolist()) == ([1, 0, 1, 1], [0, 1, 0, 0])


def test_an_hour_and_a_thousand_vehicles_are_thinned_out(tmp_path: Path) -> None:
    hour = np.linspace(0.0, 3600.0, 36_001)
    noise = np.random.default_rng(3).normal(size=len(hour))
    columns = flying(["d1"], hour)
    columns["d1.noise"] = (noise, "")
    shown = page(write_run(tmp_path / "hour", columns))
    rows, values = shown.signal("d1.noise")
    assert (
        len(rows) < 6100 and values.max() == pytest.approx(noise.max()) and values.min() == pytest.approx(noise.min())
    )
    assert {0, len(hour) - 1} <= {*rows}
    minute = np.arange(0, 60.0, 0.05)
    many = page(write_run(tmp_path / "many", flying([f"d{i}" for i in range(1000)], minute)))
    frames = many.array(many.run["motion"]["frames"])
    assert len(frames) * 1000 <= 1_001_000 and np.diff(minute[frames]).max() <= 0.11
    assert len(many.text) < 16e6


def test_thinned_rows() -> None:
    ramp = np.arange(1000.0)
    assert thinned(np.ones(9), 4, discrete=False).tolist() == [0]
    assert thinned(np.full(9, np.nan), 4, discrete=False).tolist() == [0]
    assert thinned(ramp[:4], 4, discrete=False).tolist() == [0, 1, 2, 3]
    assert thinned(ramp, 10, discrete=False).tolist() == [0, 199, 200, 399, 400, 599, 600, 799, 800, 999]
    assert thinned(np.array([1, 1, 2, 2, 1]), 4, discrete=True).tolist() == [0, 2, 4]
    gap = np.where((ramp > 300) & (ramp < 310), np.nan, ramp)
    assert {300, 301, 309, 310} <= {*thinned(gap, 20, discrete=False)}
    assert len(thinned(np.empty(0), 4, discrete=False)) == 0


def test_a_block_takes_what_the_page_reads() -> None:
    block = Block()
    assert block.add(np.array([1.5, 2.5]), "f4") == (0, "f4", 2)
    assert block.add(np.array([7]), "u1") == (8, "u1", 1)
    with pytest.raises(ValueError, match=r"f2: the page reads f4, f8"):
        block.add(np.array([1.0]), "f2")


def test_the_page_asks_nobody_and_runs_nothing_but_its_own(tmp_path: Path) -> None:
    text = write_page(evil_run(tmp_path / "run")).read_text(encoding="utf-8")
    (rules,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', text)
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    styles = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    assert (len(scripts), len(styles)) == (1, 1)
    for kind, (content,) in (("script", scripts), ("style", styles)):
        digest = re.findall(rf"{kind}-src 'sha256-([^']*)'", rules)
        assert [b64decode(one) for one in digest] == [sha256(content.encode()).digest()]
    assert "default-src 'none'" in rules and "unsafe" not in rules
    (title,) = re.findall(r"<title>(.*?)</title>", text, re.DOTALL)
    assert title.startswith("&lt;/script&gt;&lt;script&gt;window") and title.isprintable()
    assert "hacked" not in text.replace(title, "")  # else names are in the compressed data only
    outside = text.replace(scripts[0], "")
    assert not re.findall(r"(?:src|href)=\"(?!data:,)", outside)
    assert len(text) - len(re.findall(r'id="data">([^<]*)<', text)[0]) < 2e6


def test_a_title_is_escaped(tmp_path: Path) -> None:
    text = write_page(write_run(tmp_path / "run", flying(["d"], TIME), system={"name": "<b>&x"})).read_text("utf-8")
    assert "<title>&lt;b&gt;&amp;x - uav-cosim</title>" in text


def test_a_recording_without_vehicles_or_packets(tmp_path: Path) -> None:
    columns = {"time": (TIME, "s"), "tank.level": (np.sin(TIME), "m"), "tank.same": (0 * TIME, "m")}
    shown = page(write_run(tmp_path / "run", columns))
    assert shown.run["vehicles"] == [] and shown.run["traffic"]["links"] == []
    assert shown.run["plots"] == [[0]]


def test_what_cannot_be_shown(tmp_path: Path) -> None:
    with pytest.raises(CosimError, match=r"not the folder of a run: it has no manifest\.json \(`uav-cosim run -o`"):
        write_page(tmp_path)
    with pytest.raises(
        CosimError, match="gone: not the folder of a run: there is no such folder; a run prints its own"
    ):
        write_page(tmp_path / "gone")
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.json").write_text("{}", encoding="utf-8")
    with pytest.raises(
        CosimError, match=r"not the folder of a run: it holds a campaign; try uav-cosim report \S+study$"
    ):
        write_page(tmp_path / "study")
    (tmp_path / "manifest.json").write_text("[]", encoding="utf-8")
    with pytest.raises(CosimError, match=r"not the manifest of a complete run: a list, not an object"):
        write_page(tmp_path)
    (tmp_path / "manifest.json").write_text('{"instances": {}}', encoding="utf-8")
    with pytest.raises(CosimError, match=r"it has no signals\.parquet"):
        write_page(tmp_path)
    none = write_run(tmp_path / "none", {"time": (TIME[:0], "s")})
    with pytest.raises(CosimError, match=r"nothing to show: the run recorded no instant"):
        replay(none)
    run = write_run(tmp_path / "run", flying(["d"], TIME))
    with pytest.raises(CosimError, match=r"the page cannot be written: Is a directory"):
        write_page(run, tmp_path)


def test_the_verb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: not opened.append(address))  # type: ignore[func-returns-value]
    run = write_run(tmp_path / "run", flying(["d"], TIME))
    done = CliRunner().invoke(app, ["view", str(run), "--no-open"])
    assert (done.exit_code, done.stdout, opened) == (0, f"{run / 'view.html'}\n", [])
    done = CliRunner().invoke(app, ["view", str(run), "-o", str(tmp_path / "new" / "x.html"), "--json"])
    assert json.loads(done.stdout) == {"files": [str(tmp_path / "new" / "x.html")]}
    assert opened == [(tmp_path / "new" / "x.html").as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    done = CliRunner().invoke(app, ["view", str(run)])
    assert done.exit_code == 0 and "no browser was found here" in " ".join(done.stderr.split())
    done = CliRunner().invoke(app, ["view", str(tmp_path / "nothing"), "--no-open"])
    assert done.exit_code == 2 and "nothing: not the folder of a run: " in done.stderr


def test_a_page_goes_with_its_run(tmp_path: Path) -> None:
    """A new run in the folder removes it, but no page of somebody else."""
    run = write_run(tmp_path / "run", flying(["d"], TIME))
    written = write_page(run)
    (run / "own.html").write_text(EVIL, encoding="utf-8")
    clear(run)
    assert not written.exists() and (run / "own.html").exists()
