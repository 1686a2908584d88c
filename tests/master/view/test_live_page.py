"""The page of a run that goes on, in a browser: packets, messages and links as they are recorded."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
import pytest
from pymavlink import mavutil

from cosim_master.results.reading.read import packets
from tests.master.view.browser import LONG, Tab

pytestmark = pytest.mark.slow
pytest.importorskip("websockets", reason="the extra `live` is not installed")
from tests.master.view.watched import Watched  # noqa: E402


@contextmanager
def flown(browser: Any, out: Path, until: float, **options: Any) -> Iterator[tuple[Watched, Tab]]:
    """A run of `line5` in another thread, paused at its start, and its page; the run is let go in the end."""
    watched = Watched()
    watched.control.set_speed(2.0)
    flying = threading.Thread(target=lambda: watched.run(out, until=until, **options))
    flying.start()
    try:
        assert watched.begun.wait(LONG / 1000)
        tab = Tab(browser, watched.page.address)
        yield watched, tab
    finally:
        watched.control.set_speed(None)
        watched.control.resume()
        flying.join()
        watched.page.close()
    tab.page.close()


def test_packets_are_seen_while_they_fly(browser: Any, fmus: Path, tmp_path: Path) -> None:
    bad = {"network.loss": "0.3", "network.range": "35"}
    with flown(browser, tmp_path / "run", 10.0, overrides=bad) as (watched, tab):
        tab.page.keyboard.press("Space")
        tab.wait("cosim.log('STATUSTEXT').length > 2 && cosim.log('lost').length > 10")
        tab.page.keyboard.press("Space")
        tab.wait("cosim.live.paused")
        watched.standing()
        tab.ask("cosim.log('lost')")
        lost = tab.ask("cosim.log('lost')")[-1]
        tab.page.keyboard.press("t")  # without trails
        tab.at(lost["time"] + 0.001)
        assert tab.ask("cosim.flying().lost") >= lost["lost"]
        drawn = tab.picture()
        red = (drawn[:, :, 0] > 0.7) & (drawn[:, :, 1] < 0.45) & (drawn[:, :, 2] < 0.5)
        tab.page.keyboard.press("p")  # without packets
        hidden = tab.picture()
        assert tab.ask("cosim.flying()") == {"radio": 0, "lost": 0}
        changed = np.abs(drawn - hidden).max(axis=2) > 0.1
        assert (red & changed).sum() > 20
        tab.page.keyboard.press("p")
        tab.page.locator("#now").click()
        tab.page.keyboard.press("Space")
        tab.wait("cosim.live.ended !== null || cosim.time > 9")
        watched.control.set_speed(None)
        tab.wait("!cosim.live.going")
        tab.wait("cosim.end === 10")
        tab.wait("cosim.live.ended !== null")
        table = packets(tmp_path / "run")
        on_air = table.filter(pc.not_equal(table["outcome"], "on board"))
        tab.wait(f"cosim.links().reduce((sum, one) => sum + one.sent, 0) >= {on_air.num_rows}")
        log, links = tab.ask("cosim.log('')"), tab.ask("cosim.links()")
        tab.page.locator("#tabs button[data-name=links]").click()
        row = tab.page.locator("#pane-links tbody tr").first.inner_text().split()
        tab.page.locator("#tabs button[data-name=log]").click()
        assert tab.page.locator("#pane-log .row").count() > 3
        assert tab.complaints == []
    counted = {(one["from"], one["to"]): (one["sent"], one["lost"]) for one in links}
    assert sum(sent for sent, _ in counted.values()) == on_air.num_rows
    for (source, target), counts in counted.items():
        of_link = pc.and_(pc.starts_with(on_air["source"], f"{source}."), pc.equal(on_air["target"], target))
        rows = on_air.filter(of_link)
        assert counts == (rows.num_rows, rows.filter(pc.starts_with(rows["outcome"], "lost")).num_rows)
    assert row[:4] == [links[0]["from"], links[0]["to"], str(links[0]["sent"]), str(links[0]["lost"])]
    connection = mavutil.mavlink_connection(str(tmp_path / "run" / "packets.tlog"), dialect="ardupilotmega")
    texts = []
    while (message := connection.recv_match(type="STATUSTEXT")) is not None:
        texts.append(message.text)
    connection.close()
    assert [one["text"] for one in log if one["message"] == "STATUSTEXT"] == texts and len(texts) > 2
    assert {one["message"] for one in log} >= {"HEARTBEAT", "GLOBAL_POSITION_INT", "STATUSTEXT"}


def test_findings_appear_when_they_are_found(browser: Any, fmus: Path, tmp_path: Path) -> None:
    heavy = {"drone4.vehicle.mass": "30"}
    with flown(browser, tmp_path / "run", 60.0, overrides=heavy) as (watched, tab):
        button = tab.page.locator("#tabs button[data-name=findings]")
        button.click()
        assert tab.page.locator("#pane-findings").inner_text().startswith("Nothing so far.")
        watched.control.set_speed(10.0)
        tab.page.keyboard.press("Space")
        tab.wait("cosim.live.going && cosim.findings().length")
        (found,) = tab.ask("cosim.findings()")
        assert (found["severity"], found["kind"], found["vehicle"]) == ("failure", "never flew", 3)
        assert found["text"].startswith("drone4.vehicle has never left the ground")
        assert tab.ask("cosim.time") < 59.0
        assert button.get_attribute("class") == "failure" and button.locator("sup").inner_text() == "1"
        assert tab.page.locator("#pane-findings .finding.failure").inner_text().startswith("failurenever flew")
        assert tab.page.locator("#marks .finding.failure").count() == 1
        watched.control.set_speed(None)
        tab.wait("!cosim.live.going")
        verdict = json.loads((tmp_path / "run" / "manifest.json").read_text())["verdict"]
        told = tab.ask("cosim.findings()")
        assert [{name: one[name] for name in one if name != "vehicle"} for one in told] == verdict["findings"]
        assert tab.complaints == []


def test_sliders_set_values(browser: Any, fmus: Path, tmp_path: Path) -> None:
    with flown(browser, tmp_path / "run", 5.0) as (_, tab):
        tab.page.locator("#tabs button[data-name=values]").click()
        tab.ask("cosim.select('drone3')")
        tab.wait("document.querySelectorAll('.parameter').length === 40")
        tab.page.locator("#parameter").fill("drone3 vehicle.wind")
        tab.wait("document.querySelectorAll('.parameter').length === 3")
        one = tab.page.locator('.parameter[data-name="drone3.vehicle.wind[1]"]')
        slider, field = one.locator("input[type=range]"), one.locator("input[type=text]")
        assert [slider.get_attribute(name) for name in ("min", "max")] == ["-10", "10"]
        slider.focus()
        for _ in range(3):
            tab.page.keyboard.press("ArrowRight")  # of the slider, not of the time line
        value = field.input_value()
        assert float(value) > 0.0
        tab.page.locator('.parameter[data-name="drone3.vehicle.wind[2]"] input[type=text]').fill("much")
        tab.page.keyboard.press("Enter")
        tab.wait("document.getElementById('refusal').textContent.endsWith('wind[2]=much: valid: a number')")
        tab.wait("document.querySelectorAll('.parameter')[1].querySelector('input[type=text]').value === '0'")
        assert tab.ask("cosim.live.changes") == []  # the run stands still
        tab.page.locator("#play").click()
        tab.wait("cosim.live.changes.length > 0")
        made = tab.ask("cosim.live.changes")
        assert made[-1][:2] == [0.0, "drone3.vehicle.wind[1]"] and float(made[-1][2]) == float(value)
        assert f"--at 0 'drone3.vehicle.wind[1]={made[-1][2]}'" in tab.page.locator(".made pre").inner_text()
        assert tab.complaints == []
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert [[one["time"], one["variable"]] for one in manifest["changes"]] == [one[:2] for one in made]


def test_a_click_sends_the_drone_there(browser: Any, fmus: Path, tmp_path: Path) -> None:
    with flown(browser, tmp_path / "run", 40.0) as (_, tab):
        tab.ask("cosim.select('drone3')")
        tab.ask("cosim.send('drone3', 10, 5)")
        tab.wait("cosim.live.said.startsWith('drone3 cannot be sent there: its autopilot has not sent')")
        tab.page.locator("#play").click()
        tab.wait("cosim.position('drone3')[2] < -5")
        tab.page.keyboard.press("3")  # from above
        tab.page.locator("#send").click()
        assert tab.page.locator("#send").get_attribute("aria-pressed") == "true"
        at = tab.ask("cosim.screen('drone4')")
        tab.page.locator("#scene").click(position={"x": at[0], "y": at[1] - 150})
        assert tab.page.locator("#send").get_attribute("aria-pressed") == "false"
        tab.wait("/^drone3: (?!sent)/.test(cosim.live.said)")
        assert tab.ask("cosim.live.said") == "drone3: accepted"
        tab.wait("document.querySelector('.said').textContent === 'drone3: accepted'")
        assert tab.ask("cosim.selected()") == "drone3" and tab.complaints == []
    table = packets(tmp_path / "run")
    sent = table.filter(pc.equal(table["source"], "@page")).to_pylist()
    assert [(row["target"], row["message"], row["system"]) for row in sent] == [("drone3", 75, 255)]
    log = mavutil.mavlink_connection(str(tmp_path / "run" / "packets.tlog"), dialect="ardupilotmega")
    while (message := log.recv_match(type="COMMAND_INT")).get_srcSystem() != 255:
        pass
    log.close()
    assert message.y == pytest.approx(1491657887, abs=300)  # the longitude of drone 4, above which the click was
    assert message.x > -353632620 + 100  # and north of it
