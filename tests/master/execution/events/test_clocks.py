"""Clocks of FMI 3.0: when they tick, what belongs to them, and how they go from one FMU to the next.

The FMU looks at every call (clocked.c): Clocks that are set at another time than theirs or not at all, variables that
are touched while their Clocks are silent, intervals that are not asked for. Pitfall 31 of masters is all of that.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.fmus.clocked import clocked

pytestmark = pytest.mark.usefixtures("own_cache")


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def ran(stricts3: Any, system: Path, **options: Any) -> RunResult:
    result = simulate(system, RunOptions(**options))
    assert stricts3.complaints == []
    assert result.outcome == "done", result.error
    return result


def ticks(stricts3: Any, *names: str) -> list[str]:
    """The lines of calls that are about Clocks of these names, or all but steps and events."""
    lines = [line for line in stricts3.calls if not any(word in line for word in ("step", "event", "instantiated"))]
    return [line for line in lines if not names or line.split()[1] in names]


def test_a_constant_clock(stricts3: Any, tmp_path: Path) -> None:
    """Ticks between communication points and at them, and one at the start; outputs keep what they had at a tick."""
    clocked(stricts3, "a.fmu", "constant", period=0.25)
    ran(stricts3, stricts3.ssd(stricts3.component("a", "a.fmu", u=3.0), stop=1.0), out=tmp_path / "out")
    assert ticks(stricts3) == [f"a: constant {t}" for t in ("0", "0.25", "0.5", "0.75", "1")]
    got = signals(tmp_path / "out")
    assert got["a.ticks_constant"] == [1, 3, 5]
    assert got["a.all"] == [1, 3, 5]
    assert got["a.y"] == [4.0] * 3
    assert "a.constant" not in got


def test_shift_and_thirds_of_a_second(stricts3: Any) -> None:
    """Tick n is at the nanosecond next to shift + n/3 s, never a sum of rounded intervals."""
    attributes = 'intervalDecimal="0.3333" supportsFraction="true" resolution="3" intervalCounter="1" shiftCounter="2"'
    clocked(stricts3, "a.fmu", "constant", period=1 / 3, shift=2 / 3, constant=attributes)
    ran(stricts3, stricts3.ssd(stricts3.component("a", "a.fmu"), stop=1000.0))
    times = [line.split()[2] for line in ticks(stricts3)]
    assert times == [f"{round((n + 2) * 1e9 / 3) / 1e9:.9g}" for n in range(2999)]


def test_intervals_that_the_system_sets(stricts3: Any) -> None:
    """fixed and tunable Clocks with an intervalDecimal: fmi3SetInterval, with the system's interval or the FMU's."""
    clocked(stricts3, "a.fmu", "fixed", "tunable", period=0.5)
    ran(stricts3, stricts3.ssd(stricts3.component("a", "a.fmu", fixed=0.4), stop=1.0))
    lines = ticks(stricts3)
    assert lines[:2] == ["a: interval of fixed 0.4", "a: interval of tunable 0.5"]
    assert [line for line in lines[2:] if "fixed" in line] == [f"a: fixed {t}" for t in ("0", "0.4", "0.8")]
    assert [line for line in lines[2:] if "tunable" in line] == [f"a: tunable {t}" for t in ("0", "0.5", "1")]


@pytest.mark.parametrize("fraction", ["", 'supportsFraction="true"'])
def test_intervals_that_the_fmu_is_asked_for(stricts3: Any, fraction: str) -> None:
    clocked(stricts3, "a.fmu", "asked", "changing", "retuned", asked=fraction, changing=fraction, retuned=fraction)
    parts = stricts3.component("a", "a.fmu", period=0.4, shift=0.1, delay=0.2)
    ran(stricts3, stricts3.ssd(parts, stop=1.0))
    lines = ticks(stricts3)
    assert [line for line in lines if "asked" in line] == [f"a: asked {t}" for t in ("0.1", "0.5", "0.9")]
    assert [line for line in lines if "retuned" in line] == [f"a: retuned {t}" for t in ("0.1", "0.5", "0.9")]
    assert [line for line in lines if "changing" in line] == [f"a: changing {t}" for t in ("0.2", "0.6")]


@pytest.mark.parametrize("delay", [0.0, 0.125, 0.5])
def test_a_countdown(stricts3: Any, delay: float) -> None:
    """It begins with each tick of constant; with no delay it ticks in the next instant of the same time."""
    clocked(stricts3, "a.fmu", "constant", "countdown", period=0.5, shift=0.25)
    ran(stricts3, stricts3.ssd(stricts3.component("a", "a.fmu", delay=delay), stop=1.0))
    expected = {
        0.0: ["constant 0.25", "countdown 0.25", "constant 0.75", "countdown 0.75"],
        0.125: ["constant 0.25", "countdown 0.375", "constant 0.75", "countdown 0.875"],
        0.5: ["constant 0.25", "constant 0.75", "countdown 0.75"],
    }
    assert ticks(stricts3) == [f"a: {line}" for line in expected[delay]]


def test_a_tunable_clock_is_tuned_during_the_run(stricts3: Any) -> None:
    """The new interval counts from when it is set; so does one that depends on a tunable parameter."""
    clocked(stricts3, "a.fmu", "tunable", "retuned", period=0.5)
    system = stricts3.ssd(stricts3.component("a", "a.fmu"), stop=2.0)
    ran(stricts3, system, at=[(1.0, "a.tunable", "0.3"), (1.0, "a.period", "0.4")])
    lines = ticks(stricts3)
    assert [line for line in lines if "a: tunable" in line] == [
        f"a: tunable {t}" for t in ("0", "0.5", "1", "1.3", "1.6", "1.9")
    ]
    assert [line for line in lines if "retuned" in line] == [f"a: retuned {t}" for t in ("0", "0.5", "1", "1.4", "1.8")]


PAIR = "constant:input fire:output go:input u:input y:output v:input w:output"


def pair(stricts3: Any, *wires: str, stop: float = 1.0, step: float = 0.5, **values: Any) -> Path:
    clocked(stricts3, "a.fmu", "constant", "fire", period=0.25, step=step)
    clocked(stricts3, "b.fmu", "go", "fire", step=step)
    parts = stricts3.component("a", "a.fmu", ports="fire:output y:output w:output v:input", **values)
    parts += stricts3.component("b", "b.fmu", ports="go:input fire:output u:input y:output v:input w:output")
    return stricts3.ssd(parts, *wires, stop=stop)


def test_a_clock_makes_another_one_tick_at_the_same_time(stricts3: Any, tmp_path: Path) -> None:
    """a's Clock fire ticks with constant and is connected to b's go; y goes to u in the same instant."""
    ran(stricts3, pair(stricts3, "a/fire b/go", "a/y b/u", rule=1, u=10.0), out=tmp_path / "out")
    of_b = [line for line in ticks(stricts3) if line.startswith("b")]
    assert of_b == [f"b: go {t}" for t in ("0", "0.25", "0.5", "0.75", "1")]
    got = signals(tmp_path / "out")
    assert got["b.ticks_go"] == [1, 3, 5]
    assert got["b.y"] == [12.0] * 3


def test_instances_tied_by_clocks_take_the_same_steps(stricts3: Any) -> None:
    """b stops at the ticks of a, and neither may return early."""
    ran(stricts3, pair(stricts3, "a/fire b/go", rule=1))
    calls = stricts3.calls
    for name in "ab":
        assert [line for line in calls if line.startswith(f"{name}: step")] == [f"{name}: step 0.25"] * 4
        assert f"{name}: instantiated 0" in calls


def test_a_chain_of_clocks_in_one_instant(stricts3: Any, tmp_path: Path) -> None:
    """a.fire -> b.go, b.fire -> c.go: the value that goes along has been through all of them at each tick."""
    clocked(stricts3, "a.fmu", "constant", "fire", period=0.5)
    clocked(stricts3, "b.fmu", "go", "fire")
    ports = "go:input fire:output u:input y:output"
    parts = stricts3.component("a", "a.fmu", ports="fire:output y:output", rule=1, u=1.0)
    parts += "".join(stricts3.component(name, "b.fmu", ports=ports, rule=2) for name in "bc")
    wires = ("a/fire b/go", "b/fire c/go", "a/y b/u", "b/y c/u")
    ran(stricts3, stricts3.ssd(parts, *wires, stop=1.0), out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["c.ticks_go"] == [1, 2, 3]
    assert got["c.y"] == [4.0] * 3


def test_clocks_in_a_ring(stricts3: Any) -> None:
    """A Clock ticks once in an instant, even if it is what makes it tick."""
    clocked(stricts3, "b.fmu", "go", "fire")
    ports = "go:input fire:output"
    parts = stricts3.component("a", "b.fmu", ports=ports, rule=4) + stricts3.component(
        "b", "b.fmu", ports=ports, rule=2
    )
    ran(stricts3, stricts3.ssd(parts, "a/fire b/go", "b/fire a/go", stop=0.5))
    assert sorted(ticks(stricts3)) == ["a: fire 0", "a: go 0", "b: fire 0", "b: go 0"]


def test_an_event_makes_a_clock_tick_at_a_communication_point(stricts3: Any, tmp_path: Path) -> None:
    """The event is somewhere in the step, but a is tied to b and may not return early: b must not be ahead of it."""
    clocked(stricts3, "b.fmu", "go", "fire")
    parts = stricts3.component("a", "b.fmu", ports="fire:output", rule=3, when=0.5, early=1)
    parts += stricts3.component("b", "b.fmu", ports="go:input")
    ran(stricts3, stricts3.ssd(parts, "a/fire b/go", stop=1.5), out=tmp_path / "out")
    assert ticks(stricts3) == ["a: fire 1", "b: go 1", "a: fire 1.5", "b: go 1.5"]
    assert signals(tmp_path / "out")["b.ticks_go"] == [0, 0, 1, 2]


def test_an_instance_alone_returns_early_and_then_ticks(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "constant", "fire", period=0.4)
    ran(stricts3, stricts3.ssd(stricts3.component("a", "a.fmu", rule=3, when=0.5, early=1), stop=1.0))
    lines = ticks(stricts3)
    assert "a: constant 0.4" in lines and "a: constant 0.8" in lines
    assert [line for line in lines if "fire" in line] == ["a: fire 0.65", "a: fire 0.8", "a: fire 1"]


def test_values_between_what_belongs_to_clocks_and_what_does_not(stricts3: Any, tmp_path: Path) -> None:
    """a.y (of a Clock) -> b.v (of none): b sees the last tick; b.w -> c.u (of a Clock): sampled when c ticks."""
    clocked(stricts3, "a.fmu", "constant", period=0.5, shift=0.5)
    clocked(stricts3, "c.fmu", "constant", period=0.5)
    stricts3.fmu()
    parts = stricts3.component("a", "a.fmu", ports="y:output", u=6.0)
    parts += stricts3.component("b", ports="f64_in[1]:input f64_out[1]:output")
    parts += stricts3.component("c", "c.fmu", ports="u:input")
    ran(stricts3, stricts3.ssd(parts, "a/y b/f64_in[1]", "b/f64_out[1] c/u", stop=2.0), out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["a.y"] == [0.0, 7.0, 7.0, 7.0, 7.0]
    assert got["b.f64_out[1]"] == [1.0, 1.0, 8.0, 8.0, 8.0]
    assert got["c.y"] == [2.0, 2.0, 9.0, 9.0, 9.0]


def test_a_tick_in_the_middle_of_a_step_takes_what_the_step_began_with(stricts3: Any, tmp_path: Path) -> None:
    """Others have gone ahead to the end of the step by then: their future must not be seen."""
    clocked(stricts3, "c.fmu", "constant", period=0.5, shift=0.25)
    stricts3.fmu(flags='hasEventMode="true"')
    parts = stricts3.component("b", ports="events:output", mode=12, when=0.0)
    parts += stricts3.component("c", "c.fmu", ports="u:input")
    ran(stricts3, stricts3.ssd(parts, "b/events c/u", stop=2.0), out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["b.events"] == [2, 4, 6, 8, 10]
    # c ticks at 0.25, 0.75, ...: y is one more than what b had at the communication point before.
    assert got["c.y"] == [0.0, 3.0, 5.0, 7.0, 9.0]


def test_strings_and_binaries_belong_to_clocks_too(stricts3: Any, tmp_path: Path) -> None:
    clocked(stricts3, "a.fmu", "constant", "fire", period=0.5)
    clocked(stricts3, "b.fmu", "go", "fire")
    ports = "text_out:output bytes_out:output"
    parts = stricts3.component("a", "a.fmu", ports=f"{ports} fire:output", rule=1, text_in="here")
    parts += stricts3.component("b", "b.fmu", ports=f"{ports} go:input text_in:input bytes_in:input")
    system = stricts3.ssd(parts, "a/fire b/go", "a/text_out b/text_in", "a/bytes_out b/bytes_in", stop=1.0)
    ran(stricts3, system, out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["b.text_out"] == ["here"] * 3
    assert got["b.bytes_out"] == [""] * 3


def test_a_slow_instance_with_clocks(stricts3: Any, tmp_path: Path) -> None:
    """Its outputs are seen from the end of its step, as all outputs are."""
    clocked(stricts3, "slow.fmu", "constant", period=0.25, step=1.0)
    clocked(stricts3, "quick.fmu", "constant", period=0.5)
    parts = stricts3.component("a", "quick.fmu") + stricts3.component("b", "slow.fmu")
    ran(stricts3, stricts3.ssd(parts, stop=2.0), out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["b.ticks_constant"] == [1, 1, 5, 5, 9]
    assert got["a.ticks_constant"] == [1, 2, 3, 4, 5]


def test_an_array_of_instances_of_different_steps_without_clocks_beside_it(stricts3: Any, tmp_path: Path) -> None:
    """A discard elsewhere takes everything back to a copy: Clocks tick again at the same times."""
    clocked(stricts3, "a.fmu", "constant", "countdown", period=0.25)
    stricts3.fmu()
    parts = stricts3.component("a", "a.fmu", delay=0.1) + stricts3.component("b", mode=1, when=0.5, longest=0.25)
    ran(stricts3, stricts3.ssd(parts, stop=1.0), out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["a.ticks_constant"] == [1, 3, 5]
    assert got["a.ticks_countdown"] == [0, 2, 4]


# ---- what is refused -------------------------------------------------------------------------------------------------


def refused(system: Path, **options: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system, RunOptions(**options))
    return str(caught.value)


def test_ticks_that_an_fmu_cannot_hit(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "constant", period=0.3, flags='hasEventMode="true"')
    result = simulate(stricts3.ssd(stricts3.component("a", "a.fmu"), stop=1.0))
    assert result.outcome == "failed"
    assert "a tick of a Clock is at 0.3 s, in the middle of a step, and it cannot take a shorter one" in str(
        result.error
    )
    assert stricts3.complaints == []


def test_instances_tied_by_clocks_need_one_step_size(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "constant", "fire")
    clocked(stricts3, "b.fmu", "go", step=0.25)
    parts = stricts3.component("a", "a.fmu", ports="fire:output") + stricts3.component("b", "b.fmu", ports="go:input")
    error = refused(stricts3.ssd(parts, "a/fire b/go"))
    assert "connected by Clocks must have one step size, but step a by 0.5 s, b by 0.25 s" in error


def test_a_clock_that_ticks_by_itself_makes_others_tick(stricts3: Any, tmp_path: Path) -> None:
    """An input Clock that is not triggered is the source of a connection (SSP 2.0, 5.3.2.1), and values go along."""
    clocked(stricts3, "a.fmu", "constant", period=0.25)
    clocked(stricts3, "b.fmu", "go")
    parts = stricts3.component("a", "a.fmu", ports="constant:input y:output", u=10.0)
    parts += "".join(stricts3.component(name, "b.fmu", ports="go:input u:input") for name in "bc")
    wires = ("a/constant b/go", "a/y b/u", "a/constant c/go", "a/y c/u")
    ran(stricts3, stricts3.ssd(parts, *wires, stop=1.0), out=tmp_path / "out")
    assert ticks(stricts3, "go") == [f"{i}: go {t}" for t in ("0", "0.25", "0.5", "0.75", "1") for i in "bc"]
    got = signals(tmp_path / "out")
    assert got["b.ticks_go"] == got["c.ticks_go"] == got["a.ticks_constant"] == [1, 3, 5]
    assert got["b.y"] == [12.0] * 3


@pytest.mark.parametrize("delay", [0.125, 0.25])
def test_a_relay_between_two_nodes(stricts3: Any, tmp_path: Path, delay: float) -> None:
    """As a bus of FMI-LS-BUS: bytes come in with a triggered Clock and go out when a countdown ticks, to another one.

    With a delay of 0.25 s it takes the next bytes in the instant in which it gives the last ones; all inputs are set
    before any of its outputs is got.
    """
    clocked(stricts3, "a.fmu", "constant", "fire", period=0.25)
    clocked(stricts3, "r.fmu", "go", "countdown", relay=True)
    clocked(stricts3, "b.fmu", "go")
    parts = stricts3.component("b", "b.fmu", ports="go:input bytes_in:input bytes_out:output")
    parts += stricts3.component(
        "r", "r.fmu", ports="go:input countdown:input bytes_in:input bytes_out:output", rule=5, delay=delay
    )
    # The sender comes behind the others in every order of names.
    parts += stricts3.component("z", "a.fmu", ports="fire:output bytes_out:output", rule=6)
    wires = ("z/fire r/go", "z/bytes_out r/bytes_in", "r/countdown b/go", "r/bytes_out b/bytes_in")
    ran(stricts3, stricts3.ssd(parts, *wires, stop=2.0), out=tmp_path / "out")
    times = [n * 0.25 + delay for n in range(8) if n * 0.25 + delay <= 2.0]
    assert [line for line in ticks(stricts3) if line.startswith("b:")] == [f"b: go {t:.9g}" for t in times]
    got = signals(tmp_path / "out")
    assert got["z.bytes_out"] == ["01", "03", "05", "07", "09"]
    assert got["b.bytes_out"] == ["", "02", "04", "06", "08"]


def test_clocks_of_a_system_and_of_what_is_in_it(stricts3: Any, tmp_path: Path) -> None:
    """A Clock that ticks by itself leaves its system, and must be of the same kind there (SSP 2.0, 5.3.2.1)."""
    clocked(stricts3, "a.fmu", "constant", period=0.5)
    clocked(stricts3, "b.fmu", "go")
    inner = stricts3.component("a", "a.fmu", ports="constant:input")
    text = (
        '<ssd:System name="inside"><ssd:Connectors><ssd:Connector name="tick" kind="{}">'
        '<ssc:Clock intervalVariability="{}"/></ssd:Connector></ssd:Connectors>'
        f"<ssd:Elements>{inner}</ssd:Elements>"
        '<ssd:Connections><ssd:Connection startElement="a" startConnector="constant" endConnector="tick"/>'
        "</ssd:Connections></ssd:System>"
    )

    def system(kind: str, variability: str) -> Path:
        parts = text.format(kind, variability) + stricts3.component("b", "b.fmu", ports="go:input")
        file: Path = stricts3.ssd(parts, "inside/tick b/go", stop=1.0)
        file.write_text(file.read_text().replace('version="1.0" name="test"', 'version="2.0" name="test"'))
        return file

    ran(stricts3, system("output", "constant"), out=tmp_path / "out")
    assert signals(tmp_path / "out")["inside.a.ticks_constant"] == signals(tmp_path / "out")["b.ticks_go"] == [1, 2, 3]
    error = refused(system("output", "countdown"))
    assert (
        "a.constant is a constant Clock and inside.tick a countdown one; both must have one intervalVariability"
        in error
    )


def test_only_triggered_clocks_can_be_driven(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "constant", "fire")
    parts = "".join(stricts3.component(name, "a.fmu", ports="fire:output constant:input") for name in "ab")
    error = refused(stricts3.ssd(parts, "a/fire b/constant"))
    text = "b.constant is a constant Clock, which ticks by itself: it can drive a triggered input Clock, but a.fire is"
    assert f"{text} none" in error
    error = refused(stricts3.ssd(parts, "a/constant b/constant"))
    assert "a.constant is a constant Clock, which ticks by itself: it can drive a triggered input Clock" in error


def test_a_clock_goes_to_a_clock_only(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "constant", "fire")
    parts = "".join(stricts3.component(name, "a.fmu", ports="fire:output v:input") for name in "ab")
    assert "a.fire is Clock and b.v is Real" in refused(stricts3.ssd(parts, "a/fire b/v"))


@pytest.mark.parametrize(("name", "value", "message"), [
    ("constant", 0.5, "it is a constant Clock; only the interval of fixed and tunable ones"),
    ("fixed", 0.0, "outside of its range; valid: 1e-09"),
    ("fixed", -1.0, "outside of its range"),
])  # fmt: skip
def test_intervals_that_cannot_be_set(stricts3: Any, name: str, value: float, message: str) -> None:
    clocked(stricts3, "a.fmu", "constant", "fixed")
    assert message in refused(stricts3.ssd(stricts3.component("a", "a.fmu", **{name: value})))


@pytest.mark.parametrize(("name", "message"), [
    ("fixed", "it is a fixed Clock; only the interval of tunable ones can be changed"),
    ("u", "it belongs to the Clock constant: it can be set only while that ticks"),
])  # fmt: skip
def test_changes_that_cannot_be_made(stricts3: Any, name: str, message: str) -> None:
    clocked(stricts3, "a.fmu", "constant", "fixed")
    system = stricts3.ssd(stricts3.component("a", "a.fmu"))
    assert message in refused(system, at=[(1.0, f"a.{name}", "0.5")])


@pytest.mark.parametrize(("attributes", "message"), [
    ("", 'Clock "constant" is constant: it needs the attribute intervalDecimal'),
    ('intervalDecimal="0"', "its interval must be positive"),
    ('intervalDecimal="0.5" shiftDecimal="-1"', "its shift must not be negative"),
    ('intervalDecimal="often"', 'intervalDecimal "often" is not a number'),
    ('intervalDecimal="1e-999999999"', 'intervalDecimal "1e-999999999" is not a number'),
    ('intervalDecimal="1/0"', 'intervalDecimal "1/0" is not a number'),
])  # fmt: skip
def test_clocks_that_are_described_wrongly(stricts3: Any, attributes: str, message: str) -> None:
    clocked(stricts3, "a.fmu", "constant", constant=attributes)
    assert message in refused(stricts3.ssd(stricts3.component("a", "a.fmu")))


def test_clocks_need_event_mode(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "constant", flags="")
    assert 'has Clocks ("constant"), but no Event Mode' in refused(stricts3.ssd(stricts3.component("a", "a.fmu")))


def test_a_clock_that_nothing_drives_is_mentioned(stricts3: Any) -> None:
    clocked(stricts3, "a.fmu", "go")
    with read_system(stricts3.ssd(stricts3.component("a", "a.fmu"))) as structure:
        assert "a.go: nothing is connected to this Clock: it never ticks" in check(structure).notes


def test_connectors_of_ssp_2(stricts3: Any) -> None:
    """A connector may say that it is a Clock, of which kind, and which Clock it belongs to; it must be true."""
    clocked(stricts3, "a.fmu", "constant", "go")
    system = stricts3.ssd(stricts3.component("a", "a.fmu", ports="constant:input go:input u:input v:input"))
    text = system.read_text().replace('version="1.0" name="test"', 'version="2.0" name="test"')

    def saying(**inner: str) -> Path:
        changed = text
        for name, content in inner.items():
            changed = changed.replace(f'<ssd:Connector name="{name}" kind="input">', f"\\g{content}")
            changed = changed.replace(f"\\g{content}", f'<ssd:Connector name="{name}" kind="input">{content}')
        system.write_text(changed)
        return system

    good = {"constant": '<ssc:Clock intervalVariability="constant" intervalDecimal="0.5"/>', "go": "<ssc:Clock/>"}
    ran(stricts3, saying(**good, u='<ssc:Float64/><ssd:Clock name="constant"/><ssd:Clock name="go"/>'))
    error = refused(saying(constant='<ssc:Clock intervalVariability="triggered"/>', u='<ssd:Clock name="stop"/>'))
    assert 'connector "constant" is a triggered Clock, but a.fmu has it as constant' in error
    assert 'connector "u" does not belong to a Clock "stop" in a.fmu; it belongs to constant, go' in error
    error = refused(saying(v='<ssc:Clock/><ssd:Clock name="go"/>'))
    assert 'connector "v" is Clock, but a.fmu has it as Real' in error
    assert 'connector "v" does not belong to a Clock "go" in a.fmu; it belongs to none' in error
