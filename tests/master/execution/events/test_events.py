"""Event Mode of FMI 3.0: events at communication points and between them, times of events, updates, early return.

The FMU checks every call (strict3.c): steps beyond an event, Step Mode before the discrete states are updated, ...
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from tests.master.fmus.strict3 import ABLE

pytestmark = pytest.mark.usefixtures("own_cache")
EVENTS = f'{ABLE} hasEventMode="true"'
PORTS = "f64_in[1]:input f64_out[1]:output i32_in[1]:input i32_out[1]:output events:output"


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def ran(stricts3: Any, system: Path, **options: Any) -> RunResult:
    result = simulate(system, RunOptions(**options))
    assert stricts3.complaints == []
    assert result.outcome == "done" or "out" not in options, result.error
    return result


def events(calls: list[str]) -> list[str]:
    return [call for call in calls if "instantiated" not in call and "terminate" not in call]


def test_without_events_there_is_one_event_mode_at_the_start(stricts3: Any, tmp_path: Path) -> None:
    """Pitfall 27: fmi3ExitInitializationMode leads into Event Mode, and one update of discrete states out of it."""
    stricts3.fmu(flags=EVENTS)
    ran(stricts3, stricts3.ssd(stricts3.component("a"), stop=1.0), out=tmp_path / "out")
    assert stricts3.calls == ["a: instantiated without resources 1", "a: step 0.5", "a: step 0.5", "a: terminate 1"]
    assert signals(tmp_path / "out")["a.events"] == [1, 1, 1]


def test_an_event_between_communication_points(stricts3: Any, tmp_path: Path) -> None:
    """Pitfall 29: the FMU returns early, in the middle of the step from 0.5 s on, and does the rest after its event."""
    stricts3.fmu(flags=EVENTS)
    ran(stricts3, stricts3.ssd(stricts3.component("a", mode=10, when=0.5), stop=1.5), out=tmp_path / "out")
    assert events(stricts3.calls) == [
        *("a: step 0.5", "a: step 0.5", "a: event 0.75", "a: step 0.25", "a: event 1", "a: step 0.5", "a: event 1.5")
    ]
    assert signals(tmp_path / "out")["a.events"] == [1, 1, 3, 4]


def test_a_step_of_no_length(stricts3: Any, tmp_path: Path) -> None:
    """Pitfall 29: lastSuccessfulTime may be where the step began; after the event, all of it is still to be done."""
    stricts3.fmu(flags=EVENTS)
    ran(stricts3, stricts3.ssd(stricts3.component("a", mode=15, when=0.5), stop=1.0), out=tmp_path / "out")
    assert events(stricts3.calls) == ["a: step 0.5", "a: step 0.5", "a: event 0.5", "a: step 0.5"]
    assert signals(tmp_path / "out")["a.events"] == [1, 1, 2]


def test_an_fmu_that_cannot_step_shorter_does_not_return_early(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu(flags='hasEventMode="true"')
    ran(stricts3, stricts3.ssd(stricts3.component("a", mode=10, when=0.5), stop=1.0), out=tmp_path / "out")
    assert events(stricts3.calls) == ["a: step 0.5", "a: step 0.5", "a: event 1"]


def test_the_time_of_the_next_event_bounds_the_step(stricts3: Any, tmp_path: Path) -> None:
    """Pitfall 28: events at 0.6, 0.8, 1.0, 1.2 and 1.4 s; a later event makes an earlier one obsolete."""
    stricts3.fmu(flags=EVENTS)
    parts = stricts3.component("a", mode=11, when=0.6, longest=0.2) + stricts3.component("b")
    ran(stricts3, stricts3.ssd(parts, stop=1.5), out=tmp_path / "out")
    of_a = [call for call in events(stricts3.calls) if call.startswith("a")]
    assert of_a == [
        *("a: step 0.5", "a: step 0.1", "a: event 0.6", "a: step 0.2", "a: event 0.8", "a: step 0.2", "a: event 1"),
        *("a: step 0.2", "a: event 1.2", "a: step 0.2", "a: event 1.4", "a: step 0.1"),
    ]
    got = signals(tmp_path / "out")
    assert got["a.events"] == [1, 1, 4, 6]
    assert got["b.events"] == [1, 1, 1, 1]


def test_an_announced_event_that_an_fmu_cannot_hit(stricts3: Any) -> None:
    """Its step size cannot vary, and an event is within a step."""
    stricts3.fmu(flags='hasEventMode="true"')
    system = stricts3.ssd(stricts3.component("a", mode=11, when=0.6, longest=0.2), stop=1.5)
    result = simulate(system, RunOptions())
    assert result.outcome == "failed"
    assert str(result.error) == (
        "a: fmi3DoStep failed at t = 0.5 s: an event or a tick of a Clock is at 0.6 s, in the middle of a step, and it "
        "cannot take a shorter one (canHandleVariableCommunicationStepSize is false); give it a step size that divides "
        "the times of its events"
    )
    assert stricts3.complaints == []


def test_discrete_states_are_updated_until_they_are_done(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu(flags=EVENTS)
    ran(stricts3, stricts3.ssd(stricts3.component("a", mode=12, when=0.5), stop=1.0), out=tmp_path / "out")
    assert signals(tmp_path / "out")["a.events"] == [1, 1, 3]


def test_connected_fmus_are_iterated_at_one_time(stricts3: Any, tmp_path: Path) -> None:
    """a's event changes its output `events`; b, which takes it as its input, gets an event at the same time."""
    stricts3.fmu(flags=EVENTS)
    parts = stricts3.component("a", ports=PORTS, mode=12, when=0.5) + stricts3.component("b", ports=PORTS)
    system = stricts3.ssd(parts, "a/events b/i32_in[1]", stop=1.5)
    ran(stricts3, system, out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["a.events"] == [1, 1, 3, 5]
    assert got["b.i32_out[1]"][1:] == [2, 4, 6]
    assert got["b.events"][2] > got["b.events"][1]
    assert [call for call in events(stricts3.calls) if "event" in call] == [
        *("a: event 1", "b: event 1", "a: event 1.5", "b: event 1.5")
    ]


@pytest.mark.parametrize(
    ("name", "value"), [("i32_in[1]", "7"), ("b_in[2]", "true"), ("e_in", "5"), ("s_in", "x"), ("u64_in[1]", "9")]
)
def test_a_discrete_input_changes_at_an_event(stricts3: Any, tmp_path: Path, name: str, value: str) -> None:
    """2.4.7: where Event Mode is used, in it only."""
    stricts3.fmu(flags=EVENTS)
    system = stricts3.ssd(stricts3.component("a"), stop=1.5)
    ran(stricts3, system, out=tmp_path / "out", at=[(0.5, f"a.{name}", value)])
    assert events(stricts3.calls) == ["a: step 0.5", "a: event 0.5", "a: step 0.5", "a: step 0.5"]
    assert signals(tmp_path / "out")["a.events"][-1] == 2


def test_a_continuous_input_changes_without_an_event(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu(flags=EVENTS)
    ran(stricts3, stricts3.ssd(stricts3.component("a"), stop=1.0), out=tmp_path / "out", at=[(0.5, "a.f64_in[1]", "7")])
    assert events(stricts3.calls) == ["a: step 0.5", "a: step 0.5"]


WIRED = "i32_in[1]:input i32_out[1]:output s_in:input s_out:output f32_in[1]:input f32_out[1]:output"


@pytest.mark.parametrize(
    ("port", "value", "delay", "when"),
    [
        ("i32_{}[1]", "6", "", [1.0]),
        ("s_{}", "x", "", [1.0]),
        ("i32_{}[1]", "6", "0.5", [0.5, 1.5]),  # at first, it has its start value, 0, instead of 1
        ("f32_{}[1]", "0.1", "", []),
    ],
)
def test_a_discrete_input_from_an_fmu_without_events(
    stricts3: Any, tmp_path: Path, port: str, value: str, delay: str, when: list[float]
) -> None:
    """Its output changes at the end of a step; the FMU with Event Mode gets it there, at an event and once."""
    stricts3.fmu()
    stricts3.fmu("events.fmu", flags=EVENTS)
    workshop = stricts3.workshop
    parts = stricts3.component("a", ports=WIRED) + stricts3.component("b", "events.fmu", ports=WIRED)
    wire = workshop.connection(f"a/{port.format('out')}", f"b/{port.format('in')}")
    inside = f'<connection to="b.{port.format("in")}" delay="{delay}"/>' if delay else ""
    after = workshop.annotation(
        "org.uav-cosim.master", f'<master xmlns="https://uav-cosim.org/ns/1" algorithm="jacobi">{inside}</master>'
    )
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="2"/>'
    system = workshop.ssd("wired.ssd", workshop.system(parts, wire, after=after), experiment)
    ran(stricts3, system, out=tmp_path / "out", at=[(0.5, f"a.{port.format('in')}", value)])
    happened = [float(call.split()[-1]) for call in stricts3.calls if call.startswith("b: event")]
    assert happened == when
    got = signals(tmp_path / "out")
    if port.startswith("i32"):
        after_it = got["time"].index(when[-1])
        assert got["b.i32_out[1]"][after_it : after_it + 2] == [2, 8]
        assert got["b.events"][-1] == 1 + len(when)


def test_updates_without_end_are_a_failure(stricts3: Any) -> None:
    """Pitfall 28: a guard, and the FMU is named."""
    stricts3.fmu(flags=EVENTS)
    result = ran(stricts3, stricts3.ssd(stricts3.component("a", mode=13, when=0.5) + stricts3.component("b")))
    assert result.outcome == "failed"
    assert "the discrete states of a do not settle in 100 iterations at one time" in str(result.error)


def test_an_fmu_ends_the_run_in_event_mode(stricts3: Any, tmp_path: Path) -> None:
    """Pitfall 28: terminateSimulation of fmi3UpdateDiscreteStates. All have stepped until then: there is a row."""
    stricts3.fmu(flags=EVENTS)
    parts = stricts3.component("a", mode=14, when=0.5) + stricts3.component("b")
    result = simulate(stricts3.ssd(parts), RunOptions(out=tmp_path / "out"))
    assert stricts3.complaints == []
    assert result.outcome == "terminated"
    assert "a: it requested the end of the run at t = 1 s (terminateSimulation)" in str(result.error)
    assert result.simulated_s == 1.0
    assert pq.read_table(tmp_path / "out" / "signals.parquet")["time"].to_pylist() == [0.0, 0.5, 1.0]


def test_a_slow_instance_with_events(stricts3: Any, tmp_path: Path) -> None:
    """Steps of 1 s beside steps of 0.5 s: the outputs of the slow one are of the end of its step."""
    stricts3.fmu(flags=EVENTS)
    stricts3.fmu("slow.fmu", flags=EVENTS, step=1.0)
    parts = stricts3.component("a") + stricts3.component("b", "slow.fmu", mode=11, when=0.25, longest=0.5)
    ran(stricts3, stricts3.ssd(parts, stop=2.0), out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["b.events"] == [1, 1, 3, 3, 5]
    assert got["a.events"] == [1] * 5


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(
    modes=st.lists(st.sampled_from([0, 1, 2, 4, 8, 9, 10, 11, 12, 13, 14, 15]), min_size=2, max_size=3),
    when=st.lists(st.sampled_from([0.0, 0.3, 0.5, 0.75, 1.1]), min_size=3, max_size=3),
    longest=st.sampled_from([0.1, 0.25, 0.5]),
    flags=st.lists(st.sampled_from([EVENTS, ABLE, 'hasEventMode="true"', ""]), min_size=3, max_size=3),
    steps=st.lists(st.sampled_from([0.25, 0.5, 1.0]), min_size=3, max_size=3),
)
def test_whatever_happens_the_state_table_is_kept(
    stricts3: Any, modes: list[int], when: list[float], longest: float, flags: list[str], steps: list[float]
) -> None:
    """Events, discards, early returns, errors and ends of up to three connected FMUs: no FMU complains."""
    parts, wires = "", []
    for i, mode in enumerate(modes):
        stricts3.fmu(f"f{i}.fmu", flags=flags[i], step=steps[i])
        values = {"mode": mode, "when": when[i], "longest": longest}
        parts += stricts3.component(f"m{i}", f"f{i}.fmu", ports=PORTS, **values)
        if i > 0:
            wires += [f"m{i - 1}/f64_out[1] m{i}/f64_in[1]", f"m{i - 1}/events m{i}/i32_in[1]"]
    result = ran(stricts3, stricts3.ssd(parts, *wires, stop=2.0))
    assert result.outcome in ("done", "failed", "terminated")
    if not set(modes) & {1, 2, 4, 13, 14}:
        assert result.outcome == "done", result.error


def test_events_do_not_hurry_a_delayed_connection(stricts3: Any, tmp_path: Path) -> None:
    """b takes what a had 0.5 s ago, at events too: a's `events` are 2, 4, 6, ... from 0 s on."""
    stricts3.fmu(flags=EVENTS)
    parts = stricts3.component("a", ports=PORTS, mode=12) + stricts3.component("b", ports=PORTS, mode=12)
    workshop = stricts3.workshop
    inner = '<connection to="b.i32_in[1]" delay="0.5" start="-1"/>'
    master = workshop.annotation("org.uav-cosim.master", f'<master xmlns="https://uav-cosim.org/ns/1">{inner}</master>')
    wires = workshop.connection("a/events", "b/i32_in[1]")
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="2"/>'
    system = workshop.ssd("d.ssd", workshop.system(parts, wires, after=master), experiment)
    ran(stricts3, system, out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert got["a.events"] == [2, 4, 6, 8, 10]
    # In the step to t, b has what a had 0.5 s before that step began.
    assert got["b.i32_out[1]"] == [0, 0, 3, 5, 7]
