"""The page in a browser: a few seconds of `line5` with a bad radio and a drone too heavy to fly."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from pymavlink import mavutil

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.reading.read import packets, signals
from cosim_master.view.page import write_page
from tests.master.view.browser import LONG, Tab
from tests.master.view.recordings import evil_run

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]
DRONES = ["drone1", "drone2", "drone3", "drone4", "drone5"]


@pytest.fixture(scope="module")
def run(fmus: Path, browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("line5") / "run"
    bad = {"network.loss": "0.3", "network.range": "35", "drone4.vehicle.mass": "1000"}
    result = simulate(ROOT / "master" / "systems" / "line5", RunOptions(out=folder, until=14.0, overrides=bad))
    assert result.outcome == "done"
    return folder


@pytest.fixture(scope="module")
def tab(run: Path, browser: Any) -> Iterator[Tab]:
    yield Tab(browser, write_page(run))


@pytest.fixture(scope="module")
def table(run: Path) -> pa.Table:
    return signals(run)


def recorded(table: pa.Table, name: str, time: float) -> float:
    return float(np.interp(time, table["time"].to_numpy(), table[name].to_numpy()))


def position(table: pa.Table, drone: str, time: float) -> list[float]:
    return [recorded(table, f"{drone}.vehicle.position[{i}]", time) for i in (1, 2, 3)]


def test_the_scene_is_not_blank(tab: Tab) -> None:
    tab.at(12.0)
    pixels = tab.picture()
    assert len(np.unique((pixels * 255).astype(int).reshape(-1, 3), axis=0)) > 500
    place = tab.ask("cosim.screen('drone1')")
    x, y = round(place[0]), round(place[1])
    around = pixels[y - 15 : y + 15, x - 30 : x + 30]
    blue = around[(around[:, :, 2] > around[:, :, 0] + 0.2) & (around[:, :, 2] > 0.5)]
    assert len(blue) > 40  # its body and rotors in its own colour, where the page says that it is
    tab.ask("cosim.look('top')")
    assert np.abs(tab.picture() - pixels).mean() > 0.01
    tab.ask("cosim.look('free')")


@pytest.mark.parametrize("time", [0.0, 7.0, 9.4321, 14.0])
def test_vehicles_are_where_they_were_recorded(tab: Tab, table: pa.Table, time: float) -> None:
    tab.at(time)
    assert tab.ask("cosim.vehicles") == DRONES
    for drone in DRONES:
        assert tab.ask(f"cosim.position('{drone}')") == pytest.approx(position(table, drone, time), abs=2e-3)
    assert [tab.ask(f"cosim.rotors('{drone}')") for drone in DRONES] == [4] * 5


def test_the_slider_moves_them(tab: Tab, table: pa.Table) -> None:
    tab.at(0.0)
    box = tab.page.locator("#slider").bounding_box()
    tab.page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    tab.drawn()
    time = tab.ask("cosim.time")
    assert time == pytest.approx(0.75 * 14.0, abs=0.1)
    assert tab.page.locator("#clock").inner_text().startswith(f"{time:.2f}")
    assert tab.ask("cosim.position('drone2')") == pytest.approx(position(table, "drone2", time), abs=2e-3)
    assert -tab.ask("cosim.position('drone2')")[2] > 1.0  # it flies, and drone 4 does not
    assert abs(tab.ask("cosim.position('drone4')")[2]) < 0.01


def test_it_plays_and_pauses(tab: Tab) -> None:
    tab.at(3.0)
    tab.page.keyboard.press("Space")
    assert tab.ask("cosim.playing")
    tab.wait("cosim.time > 3.2")
    tab.page.keyboard.press("Space")
    stopped = tab.ask("cosim.time")
    tab.drawn()
    assert tab.ask("[cosim.time, cosim.playing]") == [stopped, False]
    tab.page.keyboard.press("End")
    assert tab.ask("cosim.time") == 14.0
    tab.page.keyboard.press("Home")
    assert tab.ask("cosim.time") == 0.0
    tab.page.keyboard.press("Shift+ArrowRight")
    assert tab.ask("cosim.time") == 1.0


def test_plots_show_the_recorded_values(tab: Tab, table: pa.Table) -> None:
    assert {name for plot in tab.ask("cosim.plots()") for name in plot["signals"]} >= {"drone1.vehicle.position[3]"}
    tab.ask("cosim.plot('drone3.vehicle.velocity[3]', 'drone2.agent.state', 'drone*.vehicle.position[2]')")
    first, state, every = tab.ask("cosim.plots()")
    assert first["signals"] == ["drone3.vehicle.velocity[3]"]
    time = table["time"].to_numpy()
    values = table["drone3.vehicle.velocity[3]"].to_numpy()
    shown = np.interp(first["time"], time, values)
    np.testing.assert_allclose(first["values"][0], shown, atol=1e-6)
    assert len(first["time"]) > 500 and (first["time"][0], first["time"][-1]) == (time[0], time[-1])
    states = table["drone2.agent.state"].to_numpy()
    changes = np.flatnonzero(np.diff(states)) + 1
    np.testing.assert_allclose(state["time"], [time[0], *time[changes], time[-1]], atol=1e-6)
    assert state["values"][0] == [*states[[0, *changes]], states[-1]]
    assert every["signals"] == [f"{drone}.vehicle.position[2]" for drone in DRONES]
    tab.at(8.0)
    wanted = recorded(table, "drone3.vehicle.velocity[3]", 8.0)
    assert float(tab.page.locator(".plot header b").first.inner_text().split()[0]) == pytest.approx(wanted, abs=1e-3)
    assert tab.ask("cosim.value('drone2.agent.state')") == "takeoff"


def test_any_signal_is_found_and_plotted(tab: Tab) -> None:
    tab.ask("cosim.plot()")
    tab.page.keyboard.press("/")
    tab.page.keyboard.type("drone5 rotor_speed[2]")
    tab.page.keyboard.press("Enter")
    assert [plot["signals"] for plot in tab.ask("cosim.plots()")] == [["drone5.vehicle.rotor_speed[2]"]]


def test_the_log_has_all_messages_by_name(tab: Tab, run: Path) -> None:
    connection = mavutil.mavlink_connection(str(run / "packets.tlog"), dialect="ardupilotmega")
    names, texts = [], []
    while (message := connection.recv_match()) is not None:
        names.append(message.get_type())
        if message.get_type() == "STATUSTEXT":
            texts.append(message.text)
    connection.close()
    log = tab.ask("cosim.log('')")
    assert [entry["message"] for entry in log] == names
    said = tab.ask("cosim.log('STATUSTEXT')")
    assert [entry["text"] for entry in said] == texts and len(texts) > 0
    commands = tab.ask("cosim.log('command_long drone3.agent -drone1')")
    assert {entry["message"] for entry in commands} == {"COMMAND_LONG"}
    assert {entry["source"] for entry in commands} == {"drone3.agent"}
    assert "target_system 3" in commands[0]["text"]
    lost = tab.ask("cosim.log('lost')")
    assert 0 < len(lost) < len(log) and all(entry["lost"] for entry in lost)
    tab.page.keyboard.press("l")
    tab.ask("cosim.log('STATUSTEXT')")
    tab.page.locator("#pane-log .row").first.click()
    assert tab.ask("cosim.time") == pytest.approx(said[0]["time"], abs=1e-6)


def test_links_count_what_was_recorded(tab: Tab, run: Path) -> None:
    table = packets(run)
    on_air = table.filter(pc.not_equal(table["outcome"], "on board"))
    for link in tab.ask("cosim.links()"):
        of_link = pc.and_(pc.starts_with(on_air["source"], f"{link['from']}."), pc.equal(on_air["target"], link["to"]))
        rows = on_air.filter(of_link)
        lost = rows.filter(pc.starts_with(rows["outcome"], "lost"))
        assert (link["sent"], link["lost"]) == (rows.num_rows, lost.num_rows)
        assert sum(link["causes"].values()) == link["lost"]
    assert sum(link["sent"] for link in tab.ask("cosim.links()")) == on_air.num_rows
    assert any("lost: range" in link["causes"] for link in tab.ask("cosim.links()"))  # drone 5 is out of reach


def test_packets_fly_as_links(tab: Tab, run: Path) -> None:
    table = packets(run)
    tab.at(0.0)
    assert tab.ask("cosim.flying()") == {"radio": 0, "lost": 0}
    lost = table.filter(pc.starts_with(table["outcome"], "lost"))["sent"].to_numpy()
    tab.at(float(lost[len(lost) // 2]) + 0.001)
    assert tab.ask("cosim.flying().lost") > 0
    radio = table.filter(pc.equal(table["outcome"], "radio"))
    tab.at(float(radio["sent"].to_numpy()[50]) + 0.01)
    assert tab.ask("cosim.flying().radio") > 0


def test_findings_stand_on_the_time_line(tab: Tab) -> None:
    (finding,) = [one for one in tab.ask("cosim.findings()") if one["kind"] == "never flew"]
    assert finding["who"] == ["drone4.vehicle"] and finding["severity"] == "failure"
    mark = tab.page.locator("#marks .finding.failure").first
    line = tab.page.locator("#marks").bounding_box()
    box = mark.bounding_box()
    wanted = line["x"] + line["width"] * finding["time"] / 14.0
    assert box["x"] + box["width"] / 2 == pytest.approx(wanted, abs=2)
    mark.click()
    assert tab.ask("cosim.time") == pytest.approx(finding["time"])
    assert tab.ask("cosim.selected()") == "drone4"
    assert finding["text"] in tab.page.locator("#pane-findings").inner_text()
    assert "1 failure" in tab.page.locator("#outcome").inner_text()


def test_the_address_leads_there(tab: Tab, browser: Any, run: Path) -> None:
    tab.ask("location.hash = '#t=9.5&camera=top&select=drone3&theme=light&tab=links'")
    tab.wait("cosim.time === 9.5")
    assert tab.ask("[cosim.camera, cosim.selected(), cosim.theme]") == ["top", "drone3", "light"]
    assert tab.page.locator("#pane-links").is_visible()
    light = tab.picture()
    assert light.mean() > 0.6
    tab.ask("location.hash = '#t=nonsense&camera=none&select=nobody&theme=dark&speed=-1'")
    tab.wait("cosim.theme === 'dark'")
    assert tab.ask("[cosim.time, cosim.camera, cosim.selected()]") == [9.5, "top", None]
    assert tab.picture().mean() < 0.35
    tab.ask("cosim.seek(4); cosim.look('follow')")
    tab.wait("location.hash.includes('camera=follow') && location.hash.includes('t=4')")


def test_keys_choose_cameras_and_vehicles(tab: Tab, table: pa.Table) -> None:
    tab.page.keyboard.press("Escape")
    tab.page.keyboard.press("1")
    for key, camera in (("2", "follow"), ("3", "top"), ("1", "free")):
        tab.page.keyboard.press(key)
        assert tab.ask("cosim.camera") == camera
    tab.page.keyboard.press("Escape")
    tab.page.keyboard.press("Tab")
    tab.page.keyboard.press("Tab")
    assert tab.ask("cosim.selected()") == "drone2"
    tab.page.keyboard.press("2")
    tab.at(13.0)
    x, y = tab.ask("cosim.screen('drone2')")
    size = tab.page.locator("#stage").bounding_box()
    assert (x, y) == (pytest.approx(size["width"] / 2, abs=2), pytest.approx(size["height"] / 2, abs=2))
    card = tab.page.locator("#card").inner_text()
    assert f"{-position(table, 'drone2', 13.0)[2]:.2f} m" in card and "ready" in card
    tab.page.keyboard.press("?")
    assert tab.page.locator("#keys").is_visible() and "play, pause" in tab.page.locator("#keys").inner_text()
    told = tab.ask("[...document.querySelectorAll('#keys kbd')].map((key) => key.textContent)")
    written = (ROOT / "docs" / "view.md").read_text(encoding="utf-8")
    assert {key for key in told if len(key) == 1 and key.isascii()} <= {*re.findall(r"`(.)`", written)}
    tab.page.keyboard.press("?")
    assert not tab.page.locator("#keys").is_visible()
    tab.page.keyboard.press("1")


def test_it_asked_nobody_and_complained_of_nothing(tab: Tab) -> None:
    """After all that was done above."""
    assert [url for url in tab.requests if not url.startswith(("file:", "data:"))] == []
    assert tab.complaints == []


def test_malicious_names_are_text(browser: Any, tmp_path: Path) -> None:
    tab = Tab(browser, write_page(evil_run(tmp_path / "run")))
    for name in ("plots", "log", "links", "findings", "run"):
        tab.page.locator(f"#tabs button[data-name={name}]").click()
        tab.drawn()
    tab.page.locator("#legend button").first.click()
    tab.at(2.5)
    tab.page.keyboard.press("/")
    tab.page.keyboard.type("script")
    assert tab.page.locator(".finder li").count() >= 3
    tab.page.keyboard.press("Enter")
    assert len(tab.ask("cosim.plots()")) > 0
    assert tab.ask("cosim.vehicles[0]").startswith("</script><script>")
    assert "</script>" in tab.page.locator("#system").inner_text()
    assert tab.ask("document.querySelectorAll('#app script, #app img, body > img').length") == 0
    assert tab.ask("window.hacked") is None
    assert tab.complaints == []
    tab.page.close()


def test_a_recording_without_vehicles_has_its_plots(browser: Any, tmp_path: Path) -> None:
    from tests.master.view.recordings import write_run

    time = np.arange(0, 5.0, 0.1)
    tab = Tab(browser, write_page(write_run(tmp_path / "run", {"time": (time, "s"), "tank.level": (2 * time, "m")})))
    assert "No positions were recorded" in tab.page.locator("#empty").inner_text()
    (plot,) = tab.ask("cosim.plots()")
    np.testing.assert_allclose(plot["values"][0], 2 * time, atol=1e-6)
    tab.at(2.55)
    assert tab.page.locator(".plot header b").inner_text().startswith("5.1")
    tab.page.keyboard.press("2")  # nobody to follow
    assert tab.ask("cosim.camera") == "free" and tab.complaints == []
    tab.page.close()


def test_a_run_is_seen_while_it_goes_on(browser: Any, fmus: Path, tmp_path: Path) -> None:
    """Vehicles move; a pause holds the time, a step moves it by one communication interval; at last it is a replay."""
    pytest.importorskip("websockets", reason="the extra `live` is not installed")
    from tests.master.view.watched import Watched

    watched = Watched()
    watched.control.set_speed(2.0)
    ended = threading.Event()

    def fly() -> None:
        watched.run(tmp_path / "run", until=160.0)
        ended.set()

    flying = threading.Thread(target=fly)
    flying.start()
    assert watched.begun.wait(LONG / 1000)
    tab = Tab(browser, watched.page.address, scheme="light")
    assert tab.ask("[cosim.time, cosim.live.paused]") == [0, True]
    assert tab.ask("cosim.position('drone5')") == pytest.approx([0.0, 100.0, 0.0], abs=0.05)
    tab.page.keyboard.press("Space")
    tab.wait("!cosim.live.paused && cosim.position('drone1')[2] < -1")  # it has taken off
    tab.page.locator("#play").click()
    tab.wait("cosim.live.paused")
    tab.wait(f"cosim.time === {watched.standing()!r}")
    time = tab.ask("cosim.time")
    frames = tab.ask("cosim.live.frames")
    for _ in range(5):
        tab.drawn()
    assert (tab.ask("cosim.time"), tab.ask("cosim.live.frames")) == (time, frames)
    assert tab.page.locator("#outcome").inner_text() == "paused"
    for n, do in enumerate((lambda: tab.page.keyboard.press("."), tab.page.locator("#step").click), 1):
        do()
        tab.wait(f"cosim.live.frames === {frames + n}")
        assert tab.ask("cosim.time") == pytest.approx(time + n * 0.0025, abs=1e-9)
    assert len(tab.ask("cosim.plots()[0].signals")) == 5
    pixels = tab.picture()
    tab.page.locator("#speed").select_option(label="max")
    tab.page.keyboard.press("Space")
    tab.wait("!cosim.live.going")
    assert ended.wait(LONG / 1000)
    flying.join()
    watched.page.close()
    tab.wait("cosim.end === 160")
    assert tab.ask("cosim.time") == 160.0
    assert tab.page.locator("#outcome").inner_text() == "ended: done"
    assert np.abs(tab.picture() - pixels).mean() > 0.005
    tab.at(160.0)
    table = signals(tmp_path / "run")
    for drone in DRONES:
        assert tab.ask(f"cosim.position('{drone}')") == pytest.approx(position(table, drone, 160.0), abs=2e-3)
    tab.page.keyboard.press("Home")
    tab.page.keyboard.press("Space")  # now it plays what it has
    tab.wait("cosim.time > 0.2")
    assert {url.split("/")[2] for url in tab.requests if url.startswith(("http", "ws"))} == {
        watched.page.address.split("/")[2]
    }
    assert tab.complaints == []
