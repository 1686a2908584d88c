"""The live page's server, by a client of its own: what it sends, what it refuses, and that no run notices it."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.variables import Variable
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import Column, Progress, Seen
from cosim_master.system.settings.network import Network
from cosim_master.view.live import document as document_module
from cosim_master.view.live.feed import Feed
from cosim_master.view.live.parameters import Parameters
from cosim_master.view.live.sending import Sending

websockets = pytest.importorskip("websockets", reason="the extra `live` is not installed")
from websockets.sync.client import connect  # noqa: E402

from cosim_master.view.live.server import LivePage  # noqa: E402
from tests.master.view.watched import LINE5, Watched  # noqa: E402

LONG = 120.0
"""s; every wait is for an event."""


def column(name: str, kind: str, place: int) -> Column:
    return Column(name, kind, place, Variable(name, 0, kind, "output", "continuous", None))


def nothing(control: Control) -> tuple[Parameters, Sending]:
    checked: Any = SimpleNamespace(instances=(), links=())
    return Parameters(checked, control), Sending(Network(), {}, None, Mailbox())


class Run:
    """The values of a run that this test makes up."""

    def __init__(self) -> None:
        columns = (column("a.n", "Integer", 1), column("a.x", "Real", 0), column("a.y", "Real", 2))
        view: Any = SimpleNamespace(columns=columns)
        self.reals, self.integers = np.array([1.5, 2.5, 3.5]), np.array([7, 8], dtype=np.int32)
        self.feed = Feed(view)

    def begin(self) -> None:
        self.feed.initialised(Seen(0.0, self.reals, self.integers))

    def go(self, time: float) -> None:
        self.reals[0] = 10.0 * time
        self.feed.progressed(Progress(time, 0.0, 9.0, 2.0 * time, {"sent": 0}))


@pytest.fixture
def control() -> Control:
    return Control(2.0)


@pytest.fixture
def run() -> Run:
    return Run()


@pytest.fixture
def page(run: Run, control: Control) -> Iterator[LivePage]:
    document = {"name": "made up", "live": {"stop": 9.0}}
    with LivePage(document, run.feed, control, *nothing(control)) as found:
        yield found


class Reader:
    """A page: what it has received is in `frames` and `states`."""

    def __init__(self, page: LivePage, path: str = "run", **headers: Any) -> None:
        origin = page.address.partition("/" + page.address.split("/")[3])[0]
        self._opened = connect(
            page.address.replace("http:", "ws:") + path, **{"origin": origin, "proxy": None, **headers}
        )
        self.socket = self._opened.__enter__()

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.__exit__(None, None, None)

    def ask(self, what: Any) -> None:
        self.socket.send(what if isinstance(what, (str, bytes)) else json.dumps(what))

    def frame(self) -> list[float]:
        while isinstance(message := self.socket.recv(LONG), str) or np.isnan(np.frombuffer(message, "<f8")[0]):
            pass  # flights begin with NaN
        return [float(value) for value in np.frombuffer(message, "<f8")]

    def state(self) -> dict[str, Any]:
        while not isinstance(message := self.socket.recv(LONG), str):
            pass
        found: dict[str, Any] = json.loads(message)
        return found

    def code(self) -> tuple[int, str]:
        """Returns code and reason with which the server closes the connection."""
        with pytest.raises(websockets.exceptions.ConnectionClosed) as closed:
            while True:
                self.socket.recv(LONG)
        assert closed.value.rcvd is not None
        return closed.value.rcvd.code, closed.value.rcvd.reason


def got(page: LivePage, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    host = page.address.split("/")[2]
    connection = http.client.HTTPConnection(host, timeout=LONG)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read().decode()
    connection.close()
    return found


def test_the_page_is_served_on_loopback_to_who_knows_its_token(page: LivePage) -> None:
    _, _, host, token, _ = page.address.split("/")
    assert host.startswith("127.0.0.1:") and len(token) == 32
    status, headers, text = got(page, f"/{token}/")
    assert status == 200
    assert f"connect-src ws://{host}/{token}/run" in text and text.count("connect-src") == 1
    assert (headers["Cache-Control"], headers["Referrer-Policy"]) == ("no-store", "no-referrer")
    for path in ("/", "/favicon.ico", f"/{token}", f"/{token[:-1]}/", f"/{token}x/", f"/{token}/../", "/%2e%2e/"):
        assert got(page, path)[0] == 404, path
    assert token not in got(page, "/")[2]
    assert got(page, f"/{token}/", Host="evil.example")[0] == 403


def test_only_the_page_itself_may_connect(page: LivePage) -> None:
    def refused(path: str = "run", **headers: Any) -> int:
        with pytest.raises(websockets.exceptions.InvalidStatus) as refusal:
            Reader(page, path, **headers)
        found: int = refusal.value.response.status_code
        return found

    assert refused(origin="http://evil.example") == 403
    assert refused(origin=None) == 403
    assert refused(origin="http://localhost:1") == 403
    assert refused("../" + "x" * 32 + "/run") == 404
    with Reader(page) as reader:
        assert reader.state() == {"paused": False, "speed": 2.0, "ended": None, "changes": [], "said": [0, ""]}


def test_a_page_gets_the_newest_values_when_it_has_drawn_the_last(page: LivePage, run: Run) -> None:
    with Reader(page) as reader:
        reader.state()
        run.begin()
        assert reader.frame() == [0.0, 0.0, 8.0, 1.5, 3.5]
        run.integers[1] = 9
        run.go(1.0)
        assert reader.frame() == [1.0, 2.0, 9.0, 10.0, 3.5]
        for time in (2.0, 3.0, 4.0):
            run.go(time)  # two are not drawn yet: none of these is sent
        reader.ask({"do": "drawn"})
        assert reader.frame() == [4.0, 8.0, 9.0, 40.0, 3.5]
        run.go(5.0)
        page.end(("ended: done", "good", "x"))  # the last one is sent in any case
        assert reader.frame() == [5.0, 10.0, 9.0, 50.0, 3.5]
    with Reader(page) as late:
        assert late.state()["ended"] == ["ended: done", "good", "x"]
        assert late.frame() == [5.0, 10.0, 9.0, 50.0, 3.5]


def test_a_page_controls_the_run(page: LivePage, control: Control) -> None:
    with Reader(page) as reader, Reader(page) as other:
        assert reader.state() == other.state()
        reader.ask({"do": "pause"})
        assert (
            reader.state()
            == other.state()
            == {"paused": True, "speed": 2.0, "ended": None, "changes": [], "said": [0, ""]}
        )
        assert control.paused and not control.take_step()
        reader.ask({"do": "step"})
        other.ask({"do": "speed", "factor": 0.5})
        assert reader.state()["speed"] == 0.5 == control.factor
        reader.ask({"do": "speed", "factor": None})
        assert reader.state()["speed"] is control.factor is None
        assert control.take_step() and not control.take_step()
        reader.ask({"do": "resume"})
        assert reader.state()["paused"] is control.paused is False


@pytest.mark.parametrize(
    "request_",
    ["", "pause", b"\x00", '{"do": "fly"}', "[]", '{"do": "speed"}', '{"do": "speed", "factor": 0}',
     '{"do": "speed", "factor": "1"}', '{"do": "speed", "factor": true}', '{"do": "speed", "factor": NaN}',
     '{"do": "speed", "factor": 1' + "0" * 400 + "}", '{"do": "set", "name": "a.x", "value": 1}', '{"do": "find"}'],
)  # fmt: skip
def test_other_requests_end_the_connection(page: LivePage, control: Control, request_: str | bytes) -> None:
    with Reader(page) as reader, Reader(page) as other:
        reader.ask(request_)
        code, reason = reader.code()
        assert code == 1008 and reason.startswith(
            ("give drawn, pause, resume, step, speed, find, set or send", "speed: give a ")
        )
        other.ask({"do": "pause"})  # the other one stays
        assert [other.state()["paused"] for _ in range(2)] == [False, True]
    assert control.factor == 2.0


def test_long_requests_end_the_connection(page: LivePage) -> None:
    with Reader(page) as reader:
        reader.ask("x" * 2000)
        assert reader.code()[0] == 1009


def test_nothing_is_left_when_it_is_closed(run: Run, control: Control) -> None:
    before = set(threading.enumerate())
    with LivePage({"name": "x", "live": {}}, run.feed, control, *nothing(control)) as page:
        reader = Reader(page)
        with pytest.raises(OSError):
            http.client.HTTPConnection("127.0.0.2", int(page.address.split(":")[2].partition("/")[0])).connect()
    assert reader.code()[0] == 1001
    reader.__exit__()
    run.go(1.0)  # nobody is there any more
    for thread in set(threading.enumerate()) - before:
        thread.join(60.0)
        assert not thread.is_alive(), thread
    with pytest.raises(OSError):
        got(page, "/")


@pytest.mark.slow
def test_a_run_records_the_same_with_and_without_it(fmus: Path, tmp_path: Path) -> None:
    """Its reader pauses, steps and leaves, and the run goes on."""
    plain, viewed = tmp_path / "plain", tmp_path / "viewed"
    simulate(LINE5, RunOptions(out=plain, until=4.0))
    watched = Watched()
    frames: list[list[float]] = []

    def read() -> None:
        assert watched.begun.wait(LONG)
        with Reader(watched.page) as reader:
            for what in ({"do": "step"}, {"do": "step"}, {"do": "speed", "factor": 3.0}):
                frames.append(reader.frame())
                reader.ask({"do": "drawn"})
                reader.ask(what)
        watched.control.set_speed(None)
        watched.control.resume()

    reading = threading.Thread(target=read)
    reading.start()
    result = watched.run(viewed, until=4.0)
    reading.join()
    watched.page.close()
    assert result.outcome == "done"
    assert [frame[0] for frame in frames] == [0.0, 0.0025, 0.005]
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (viewed / name).read_bytes() == (plain / name).read_bytes(), name
    names = [signal["name"] for signal in watched.document["signals"]]
    vehicles = watched.document["vehicles"]
    assert [one["name"] for one in vehicles] == [f"drone{i}" for i in (1, 2, 3, 4, 5)]
    assert [names[i] for i in vehicles[1]["columns"]["position"]] == [
        f"drone2.vehicle.position[{axis}]" for axis in (1, 2, 3)
    ]
    east = [frames[0][2 + one["columns"]["position"][1]] for one in vehicles]
    assert east == [0.0, 10.0, 20.0, 50.0, 100.0]
    assert {what: len(columns) for what, columns in vehicles[0]["columns"].items()} == {
        "position": 3, "attitude": 4, "speed": 4, "desired": 3, "goal": 2,
    }  # fmt: skip
    assert (watched.document["start"], watched.document["live"]["stop"]) == (0.0, 4.0)


@pytest.mark.slow
def test_the_verb_serves_a_page(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A browser is opened where there is a display; with many signals, those of the motion are sent first."""
    opened: list[tuple[str, int]] = []

    def open_(address: str) -> bool:
        host, path = address.removeprefix("http://").split("/", 1)
        connection = http.client.HTTPConnection(host, timeout=LONG)
        connection.request("GET", f"/{path}")
        opened.append((address, connection.getresponse().status))
        connection.close()
        return True

    monkeypatch.setattr("webbrowser.open", open_)
    monkeypatch.setattr(document_module, "_SIGNALS", 0)
    command = ["run", str(LINE5), "--until", "0.1", "--view", "--pace", "1000", "-q", "-o", str(tmp_path / "out")]
    monkeypatch.setenv("DISPLAY", ":7")
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count(f"live view: {opened[0][0]}") == 1 and opened[0][1] == 200
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for more in ([], ["--no-open"]):
        done = CliRunner().invoke(app, [*[one for one in command if one != "-q"], *more])
        assert done.exit_code == 0 and "live view: http://127.0.0.1:" in done.stderr
        assert ("no browser was found here" in " ".join(done.stderr.split())) is not bool(more)
    assert len(opened) == 1


def test_it_says_when_its_server_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "websockets", None)
    done = CliRunner().invoke(app, ["run", str(LINE5), "--view", "--no-open"])
    assert done.exit_code == 2
    assert "websockets is not installed; try pip install 'uav-cosim[live]'" in " ".join(done.stderr.split())


def test_no_open_belongs_to_view() -> None:
    done = CliRunner().invoke(app, ["run", str(LINE5), "--no-open"])
    assert done.exit_code == 2 and "--no-open belongs to --view" in done.stderr
