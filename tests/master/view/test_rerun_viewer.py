"""Rerun's viewer: what is served on loopback, what its page asks for, and what the verb does."""

from __future__ import annotations

import http.client
import io
import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.formats import export_run, format_of
from cosim_master.results.export.options import Options
from tests.master.view.browser import LONG
from tests.master.view.recordings import flying, write_run

rerun_cli = pytest.importorskip("rerun_cli", reason="the extra `rerun` is not installed")

from cosim_master.view.programs.rerun_viewer import RerunViewer  # noqa: E402


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("runs") / "run", flying(["one", "two"], np.arange(0.0, 5.0, 0.05)))


@pytest.fixture(scope="module")
def file(run: Path) -> Path:
    written = run.parent / "two drones.rrd"
    export_run(run, format_of(written), written, Options())
    return written


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in [name for name in os.environ if name.startswith("XDG_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def viewer(file: Path, home: Path) -> Iterator[RerunViewer]:
    with RerunViewer(file) as found:
        yield found


def got(address: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    _, _, host, path = address.split("/", 3)
    connection = http.client.HTTPConnection(host, timeout=LONG / 1000)
    connection.request("GET", f"/{path}", headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def test_page_and_recording_are_served_on_loopback_to_who_knows_the_token(viewer: RerunViewer, file: Path) -> None:
    place, _, query = viewer.address.partition("?")
    _, _, host, token, _ = place.split("/")
    assert host.startswith("127.0.0.1:") and len(token) == 32
    assert query == f"url=http%3A%2F%2F{host.replace(':', '%3A')}%2F{token}%2Ftwo%2520drones.rrd&persist=false"
    status, headers, page = got(viewer.address)
    assert status == 200 and b"re_viewer.js" in page and b"fonts.googleapis.com" not in page
    assert headers["Content-Security-Policy"].startswith("default-src 'none'; connect-src 'self'; ")
    assert got(f"{place}two%20drones.rrd")[2] == file.read_bytes()
    assert got(f"{place}re_viewer_bg.wasm")[2][:4] == b"\0asm"
    for path in ("", "two%20drones.rrd", f"{token}x/", f"{token}/x", f"{token}/../etc/passwd", "re_viewer.js"):
        assert got(f"http://{host}/{path}")[0] == 404, path
    assert got(place, Host="evil.example")[0] == 403
    port = int(host.partition(":")[2])
    with pytest.raises(OSError):
        http.client.HTTPConnection("127.0.0.2", port).connect()


def listening(pid: int) -> set[str]:
    """The addresses at which a process listens, as Linux writes them."""
    sockets = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        target = str(descriptor.readlink())
        if target.startswith("socket:["):
            sockets.add(target[8:-1])
    rows = [row.split() for table in ("tcp", "tcp6") for row in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]
    return {row[1].partition(":")[0] for row in rows if row[3] == "0A" and row[9] in sockets}


def test_the_program_listens_on_loopback_and_reports_nothing(file: Path, home: Path) -> None:
    with RerunViewer(file) as viewer:
        process = viewer._process
        assert listening(process.pid) == {"0100007F"}
        environment = dict(
            entry.split("=", 1) for entry in Path(f"/proc/{process.pid}/environ").read_text().split("\0") if entry
        )
        folder = Path(environment["XDG_CONFIG_HOME"])
        assert json.loads((folder / "rerun/analytics.json").read_text())["analytics_enabled"] is False
        threads = threading.active_count()
    assert process.poll() is not None and not folder.exists() and threading.active_count() < threads
    assert not [one for one in home.rglob("*") if one.is_file()], "the user's own configuration has changed"
    with pytest.raises(OSError):
        got(viewer.address)


@pytest.mark.slow
def test_the_page_shows_the_recording_and_reaches_nobody_else(viewer: RerunViewer, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme="dark")
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(viewer.address, timeout=LONG)
    place = viewer.address.partition("?")[0]

    def blue() -> int:
        """Pixels of the scene with the colour of the drones, or of their names."""
        from matplotlib.image import imread

        shot = imread(io.BytesIO(page.screenshot(timeout=LONG)), format="png")[60:660, :740, :3]
        red, _, strong = shot[..., 0], shot[..., 1], shot[..., 2]
        return int(((strong > 0.6) & (red < 0.5 * strong)).sum())

    end = time.monotonic() + 5 * LONG / 1000
    while f"{place}two%20drones.rrd" not in asked:
        assert time.monotonic() < end, asked
        page.wait_for_timeout(500)  # a sleep would keep requests from being told
    while blue() < 40:
        assert time.monotonic() < end
        page.wait_for_timeout(3000)  # pictures keep the page from drawing, on a machine without graphics
    assert {url for url in asked if not url.startswith((place, "data:", "blob:"))} == set()


def scripted(folder: Path, text: str) -> Any:
    """A package whose program is a script."""
    program = folder / "rerun"
    program.write_text(f"#!/bin/sh\n{text}\n")
    program.chmod(0o755)
    return SimpleNamespace(__file__=str(folder / "__init__.py"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[ $1 = analytics ] || echo no such option", "the Rerun viewer ended before it served a page: no such option"),
        ("exit 3", r"the Rerun viewer cannot be started: .* non-zero exit status 3"),
    ],
)
def test_a_program_that_fails(
    text: str, message: str, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun_cli", scripted(tmp_path, text))
    with pytest.raises(CosimError, match=message):
        RerunViewer(file)
    monkeypatch.setitem(sys.modules, "rerun_cli", SimpleNamespace(__file__=str(tmp_path / "none/__init__.py")))
    with pytest.raises(CosimError, match=r"the Rerun viewer cannot be started: .*No such file"):
        RerunViewer(file)


def test_the_verb_serves_the_page_until_it_is_interrupted(
    run: Path, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[str, int]] = []

    def interrupted(self: RerunViewer) -> None:
        opened.append((self.address, got(self.address)[0]))
        raise KeyboardInterrupt

    monkeypatch.setattr(RerunViewer, "wait", interrupted)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = CliRunner().invoke(app, ["view", str(run), "--rerun"])
    assert done.exit_code == 0 and done.stdout == f"{run / 'view.rrd'}\n"
    assert f"Rerun viewer: {opened[0][0]}\n" in done.stderr and opened[0][1] == 200
    assert "no browser was found here" in done.stderr


def test_the_verb_writes_the_file_only(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "x.rrd"
    done = CliRunner().invoke(app, ["view", str(run), "--rerun", "--no-open", "-o", str(file), "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout) == {"files": [str(file)]} and file.stat().st_size > 1000
    done = CliRunner().invoke(app, ["view", str(run), "--rerun", "--no-open", "-o", str(tmp_path / "x.html")])
    assert done.exit_code == 2 and "with --rerun, the end of the name must be .rrd" in " ".join(done.stderr.split())


def test_it_says_when_rerun_is_not_installed(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.partition(".")[0] == "rerun"]:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, "rerun", None)
    done = CliRunner().invoke(app, ["view", str(run), "--rerun"])
    assert done.exit_code == 2
    assert "rerun is not installed; try pip install 'uav-cosim[rerun]'" in " ".join(done.stderr.split())
