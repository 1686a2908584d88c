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
from cosim_master.system.settings.network import Network
from tests.master.linear import signals
from tests.master.scripted import Scripted, system_of, variable

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
