"""Observers of a run: what they are shown and when, and that they are closed however a run ends."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master import Observer, RunOptions, Seen, View, simulate
from cosim_master.fmi.description.variables import Variable
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.observation import Packets, Progress, Rows
from cosim_master.system.settings.network import Network
from tests.master.fmus.linear import signals
from tests.master.fmus.scripted import Scripted, system_of, variable

pytestmark = pytest.mark.usefixtures("own_cache")


class Notebook:
    """Writes down every call, and the row that is shown."""

    def __init__(self, view: View, interval: float, calls: list[tuple[str, float, list[Any]]]) -> None:
        self.every, self._view, self._calls = view.steps(interval), view, calls

    def initialised(self, seen: Seen) -> None:
        assert not seen.reals.flags.writeable
        assert not seen.integers.flags.writeable
        self._calls.append(("initialised", seen.time, self._view.row(seen)))

    def stepped(self, seen: Seen) -> None:
        self._calls.append(("stepped", seen.time, self._view.row(seen)))

    def closed(self) -> None:
        self._calls.append(("closed", -1.0, []))


def pair(linears: Any) -> Path:
    """An oscillator that drives another one; steps of 0.01 s, 1 s long."""
    linears.fmu()
    parts = linears.component("a", x0=1.0, w2=1.0, step=0.01) + linears.component("b", w2=4.0, gain=1.0, step=0.01)
    return Path(linears.ssd(parts, "a/y b/u", interval=0.01))


def test_an_observer_sees_the_recorded_values_at_its_own_instants(linears: Any, tmp_path: Path) -> None:
    calls: list[tuple[str, float, list[Any]]] = []
    names: list[str] = []

    def make(view: View) -> Observer:
        names.extend(view.names)
        return Notebook(view, 0.3, calls)

    assert simulate(pair(linears), RunOptions(out=tmp_path / "out"), observers=[make]).outcome == "done"
    assert [(what, round(time, 9)) for what, time, _ in calls] == [
        ("initialised", 0.0),
        ("stepped", 0.3),
        ("stepped", 0.6),
        ("stepped", 0.9),
        ("stepped", 1.0),
        ("closed", -1.0),
    ]
    recorded = signals(tmp_path / "out")
    assert ["time", *names] == list(recorded)
    for row, (_, _, values) in zip((0, 30, 60, 90, 100), calls, strict=False):
        assert values == [recorded[name][row] for name in names]


def test_observers_change_no_bit(linears: Any, tmp_path: Path) -> None:
    system = pair(linears)
    for out, observers in (("with", [lambda view: Notebook(view, 0.03, [])]), ("without", [])):
        assert simulate(system, RunOptions(out=tmp_path / out), observers=observers).outcome == "done"
    written = [(tmp_path / out / "signals.parquet").read_bytes() for out in ("with", "without")]
    assert written[0] == written[1]


class Ending(Notebook):
    """Looks at the communication points of two grids, and ends the run at a time."""

    prompt = False

    def __init__(self, view: View, end: float, calls: list[tuple[str, float, list[Any]]]) -> None:
        super().__init__(view, 0.02, calls)
        self.periods, self._end = (2, 3), end
        self.over = False

    def stepped(self, seen: Seen) -> None:
        super().stepped(seen)
        self.over = seen.time > self._end - 1e-9

    def packets(self, packets: Packets, *, complete: bool) -> None:
        raise AssertionError("this system has no packets")


def test_an_observer_of_points_sees_all_of_them_and_may_end_the_run(linears: Any, tmp_path: Path) -> None:
    """Steps of 0.02 and 0.03 s; a row every 0.06 s, and one where the run ends."""
    linears.fmu()
    parts = linears.component("a", x0=1.0, w2=1.0, step=0.02) + linears.component("b", w2=4.0, gain=1.0, step=0.03)
    system = Path(linears.ssd(parts, "a/y b/u", interval=0.06))
    calls: list[tuple[str, float, list[Any]]] = []
    run = RunOptions(out=tmp_path / "out")
    result = simulate(system, run, observers=[lambda view: Ending(view, 0.14, calls)])
    assert (result.outcome, round(result.simulated_s, 9), result.error) == ("violated", 0.14, None)
    points = [0.02, 0.03, 0.04, 0.06, 0.08, 0.09, 0.1, 0.12, 0.14]
    assert [round(time, 9) for what, time, _ in calls if what == "stepped"] == points
    assert calls[-1][0] == "closed"
    recorded = signals(tmp_path / "out")
    assert np.round(recorded["time"], 9).tolist() == [0.0, 0.06, 0.12, 0.14]
    whole = simulate(system, RunOptions(out=tmp_path / "whole"))
    assert whole.outcome == "done"
    assert recorded["a.y"][:3].tolist() == signals(tmp_path / "whole")["a.y"][:3].tolist()


class Collector:
    """Counts the rows of the chunks that it receives."""

    every = 0

    def __init__(self) -> None:
        self.chunks: list[tuple[int, bool]] = []
        self.times: list[float] = []
        self.calls: list[str] = []

    def initialised(self, seen: Seen) -> None:
        self.calls.append(f"initialised at {seen.time:g}")

    def stepped(self, seen: Seen) -> None:
        self.calls.append(f"stepped at {seen.time:g}")

    def rows(self, rows: Rows, *, complete: bool) -> None:
        assert not rows.reals.flags.writeable
        self.chunks.append((len(rows.time), complete))
        if complete:
            self.times += rows.time.tolist()

    def progressed(self, progress: Progress) -> None:
        self.calls.append(f"progressed to {progress.time:g}")

    def closed(self) -> None:
        self.calls.append("closed")


def test_an_observer_of_rows_receives_each_once_in_complete_chunks(
    linears: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if nothing is recorded in files. Before the last chunk, the same rows come as one that is not complete."""
    monkeypatch.setattr("cosim_master.stepping.plan._BLOCK_BYTES", 1)  # sixteen rows, the least
    collector = Collector()
    assert simulate(pair(linears), observers=[lambda _: collector]).outcome == "done"
    assert [n for n, complete in collector.chunks if complete] == [16] * 6 + [5]
    assert collector.chunks[-2:] == [(5, False), (5, True)]
    assert collector.times == pytest.approx([k / 100 for k in range(101)])
    assert collector.calls[0] == "initialised at 0"
    assert collector.calls[-2:] == ["progressed to 1", "closed"]


def test_an_observer_of_rows_receives_them_also_where_another_raises(linears: Any) -> None:
    """They are not complete, as in the recording of a process that is killed."""
    collector = Collector()

    class Wrong(Notebook):
        def stepped(self, seen: Seen) -> None:
            raise OSError(f"no space left at {seen.time:g} s")

    makers: list[Callable[[View], Observer]] = [lambda _: collector, lambda view: Wrong(view, 0.3, [])]
    with pytest.raises(OSError, match=r"no space left at 0\.3 s"):
        simulate(pair(linears), observers=makers)
    assert collector.chunks[-1] == (31, False)
    assert not any(complete for _, complete in collector.chunks)
    assert collector.calls[-1] == "closed"


def test_an_interval_that_no_look_can_have(linears: Any) -> None:
    with pytest.raises(ValueError, match=r"0\.015 s is not a multiple of the base step 0\.01 s"):
        simulate(pair(linears), observers=[lambda view: Notebook(view, 0.015, [])])


@pytest.mark.parametrize("raises", ["initialised", "stepped"])
def test_all_that_have_begun_are_closed_where_one_raises(linears: Any, raises: str) -> None:
    calls: list[tuple[str, float, list[Any]]] = []

    class Wrong(Notebook):
        def _raise(self, seen: Seen) -> None:
            raise OSError("no space left")

    setattr(Wrong, raises, Wrong._raise)
    mine: list[tuple[str, float, list[Any]]] = []
    makers: list[Callable[[View], Observer]] = [
        lambda view: Notebook(view, 0.1, calls),
        lambda view: Wrong(view, 0.1, mine),
    ]
    with pytest.raises(OSError, match="no space left"):
        simulate(pair(linears), observers=makers)
    assert calls[-1][0] == "closed"
    assert ("closed" in [what for what, *_ in mine]) is (raises == "stepped")


def test_values_of_every_type() -> None:
    """Places by hand: Booleans come after Integers; whole numbers of more than 32 bits are two halves, low first."""

    def typed(name: str, type: str, fmi_type: str, reference: int) -> Variable:
        return Variable(name, reference, type, "output", "discrete", "calculated", fmi_type=fmi_type)

    variables = [
        typed("flag", "Boolean", "Boolean", 1),
        typed("small", "Integer", "Int32", 2),
        typed("signed", "Integer", "Int64", 3),
        typed("unsigned", "Integer", "UInt64", 4),
        variable("real", "output", reference=5),
    ]
    one = Scripted("a", variables, lambda *_: None, {}, [])
    layout = make_layout(system_of([one]), Network())
    view = View(layout, 1, 0.5)
    assert view.names == ("a.flag", "a.small", "a.signed", "a.unsigned", "a.real")
    index = layout.ports["Integer"].index
    integers = np.zeros(6, np.int32)
    integers[index["a", "small"]] = -7
    integers[index["a", "signed"] :][:2] = (-2, -1)
    integers[index["a", "unsigned"] :][:2] = (-1, -1)
    integers[5] = 1
    assert view.row(Seen(0.0, np.array([0.25]), integers)) == [True, -7, -2, 2**64 - 1, 0.25]
    assert view.steps(1.5) == 3
