"""AUTOTUNE: entry, the pilot's sticks, a tune of roll and what its gains change, and what is saved."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.autotune import Delayed, Tune, begun, fly_ours
from cosim.frames import rotate
from tests.models.copter import (
    ACCEPTED,
    FAILED,
    GUIDED,
    LOITER,
    RECORDED_AUTOPILOT,
    RECORDINGS,
    STABILIZE,
    Copter,
    H,
    preset,
)
from tests.models.pilot import flown, hold, lean, override, texts

ALT_HOLD, AUTOTUNE, POSHOLD = 2, 15, 16
SET_MODE, AUX = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_AUX_FUNCTION
TEST_GAINS = 180
DONE = [("ACK", SET_MODE, ACCEPTED)]
STARTED = ("TEXT", 6, "AutoTune: Started")
STOPPED = ("TEXT", 6, "AutoTune: Stopped")
REFUSED = [("ACK", SET_MODE, FAILED), ("TEXT", 4, "Mode change to AUTOTUNE failed: init failed")]
KINDS = ("Rate D Up", "Rate D Down", "Rate P Up", "Angle P Down", "Angle P Up")
BEFORE = {
    "ATC_RAT_RLL_P": 0.135,
    "ATC_RAT_RLL_I": 0.135,
    "ATC_RAT_RLL_D": 0.0036,
    "ATC_ANG_RLL_P": 4.5,
    "ATC_ACCEL_R_MAX": 110000.0,
}
OLD = list(BEFORE.values())
CENTRED = (1500, 1500, 1500, 1500)


def in_autotune(axes: int = 1, mode: int = ALT_HOLD, model: type[Copter] = Copter, **autopilot: Any) -> Copter:
    """Tuning in the air, sticks centred by an override."""
    copter = begun(axes, mode, model, autopilot=autopilot)
    copter.heard.clear()
    return copter


def tuned(axes: int = 1, mode: int = ALT_HOLD, **autopilot: Any) -> Copter:
    """After a tune that has succeeded; the texts are kept."""
    copter = in_autotune(axes, mode, **autopilot)
    for _ in range(2000):
        hold(copter, 0.5, *CENTRED)
        if (5, "AutoTune: Success") in texts(copter):
            return copter
        assert not any("ailed" in text for _, text in texts(copter))
    raise AssertionError(f"no success in 1000 s: {texts(copter)[-3:]}")


def gains(copter: Copter) -> list[float]:
    return [float(copter.m[name]) for name in BEFORE]


# ---- entering and leaving ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [STABILIZE, ALT_HOLD, LOITER, POSHOLD])
def test_autotune_is_entered_from_these_modes(mode: int) -> None:
    copter = flown(mode)
    first = copter.ask(SET_MODE, 1, AUTOTUNE)
    assert first[:2] == [*DONE, STARTED]
    assert copter.ask(SET_MODE, 1, ALT_HOLD) == [*DONE, STOPPED]
    assert copter.ask(AUX, 17, 2)[1] == STARTED  # as a switch of the remote control does; the tune goes on


@pytest.mark.parametrize("held", [True, False])
def test_its_switch_returns_to_the_mode_of_the_mode_switch(held: bool) -> None:
    """0.2 s after the function's switch has been lowered, FLTMODE6: where the mode switch is without an override."""
    copter = in_autotune(FLTMODE6=POSHOLD)
    copter.run(0.1 if held else 3.5)
    assert copter.ask(AUX, 56, 0) == [("ACK", AUX, ACCEPTED)]  # LOITER is not the mode
    copter.run(0.4)
    assert copter.m["mode"] == AUTOTUNE
    assert copter.ask(AUX, 17, 0) == [("ACK", AUX, ACCEPTED)]
    copter.run(0.19)
    assert copter.m["mode"] == AUTOTUNE
    copter.run(0.12)
    assert copter.m["mode"] == POSHOLD
    assert texts(copter)[-1] == (6, "AutoTune: Stopped")


def test_autotune_is_refused_elsewhere() -> None:
    copter = flown(GUIDED)
    assert copter.ask(SET_MODE, 1, AUTOTUNE) == REFUSED
    copter.ask(SET_MODE, 1, ALT_HOLD)
    override(copter, 1500, 1500, 1000, 1500)
    copter.run(0.5)
    assert copter.ask(SET_MODE, 1, AUTOTUNE) == REFUSED  # the throttle is closed
    ground = Copter()
    ground.run(2.1)
    ground.ask(SET_MODE, 1, ALT_HOLD)
    override(ground, 1500, 1500, 1500, 1500)
    ground.tick()
    assert ground.ask(SET_MODE, 1, AUTOTUNE) == REFUSED
    assert ground.ask(AUX, TEST_GAINS, 2)[1] == ("TEXT", 5, "AutoTune: must be complete to test gains")


def test_sticks_interrupt_the_tune_and_its_gains() -> None:
    copter = in_a_twitch()
    assert copter.m["ATC_RAT_RLL_I"] == pytest.approx(0.01 * OLD[0])
    copter.heard.clear()
    hold(copter, 2.5, 1600, 1500, 1500, 1500)
    assert gains(copter) == OLD
    assert lean(copter)[0] == pytest.approx(30.0 * (100.0 - 20.0) / (500.0 - 20.0), abs=0.5)
    assert [text for _, text in texts(copter) if "override" in text] == 3 * ["AutoTune: pilot overrides active"]
    assert len(texts(copter)) == 3  # the tune is silent
    for sticks in ((1500, 1500, 1700, 1500), (1500, 1500, 1500, 1600)):
        hold(copter, 0.5, *sticks)
        assert gains(copter) == OLD
    override(copter, *CENTRED)
    copter.run(0.49)
    assert gains(copter) == OLD
    copter.run(0.02)
    assert copter.m["ATC_RAT_RLL_I"] == pytest.approx(0.1 * OLD[0])  # between twitches
    hold(copter, 3.0, *CENTRED)
    assert any("Roll Rate D Up" in text for _, text in texts(copter))


def in_a_twitch() -> Copter:
    copter = in_autotune()
    for _ in range(400):
        copter.tick()
        if copter.m["ATC_RAT_RLL_I"] < 0.01:
            return copter
    raise AssertionError("no twitch within a second")


def test_a_reboot_forgets_the_gains_of_a_twitch() -> None:
    copter = in_a_twitch()
    reboot = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    assert copter.ask(reboot, 1, 0, 0, 0, 0, 20190226)[0] == ("ACK", reboot, ACCEPTED)
    assert copter.m["ATC_RAT_RLL_I"] < 0.01
    copter.run(0.3)
    assert copter.m["mode"] == STABILIZE
    assert gains(copter) == OLD


def test_a_vehicle_that_never_levels_fails() -> None:
    copter = in_autotune()
    for _ in range(round(6.2 / H)):
        copter.m["tune_lean"][2] += 0.01  # a heading that runs away
        copter.tick()
    assert texts(copter)[-1] == (2, "AutoTune: Failed to level, please tune manually")
    assert gains(copter) == OLD
    copter.ask(SET_MODE, 1, ALT_HOLD)
    hold(copter, 0.5, *CENTRED)
    assert copter.ask(SET_MODE, 1, AUTOTUNE)[:2] == [*DONE, STARTED]  # from the beginning


# ---- a tune --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Roll:
    """A tune of roll: the flight, the gains that it found, and the records of vehicle and autopilot at its end."""

    tune: Tune
    found: dict[str, float]
    records: tuple[Any, Any]


@pytest.fixture(scope="module")
def roll() -> Roll:
    copter = in_autotune(model=Delayed)
    tune = fly_ours(copter)
    assert gains(copter) == OLD  # the pilot lands with them
    records = copter.v.copy(), copter.m.copy()
    copter.ask(SET_MODE, 1, ALT_HOLD)
    copter.ask(AUX, TEST_GAINS, 2)
    return Roll(tune, dict(zip(BEFORE, gains(copter), strict=True)), records)


def test_texts_tell_the_steps_in_their_order(roll: Roll) -> None:
    said, found, duration = roll.tune.texts, roll.found, roll.tune.duration
    told = [text for severity, text in said if severity == 6]
    assert len(told) == pytest.approx(duration / 2.0, abs=2)  # each 2 s
    kinds = [next(kind for kind in KINDS if f"Roll {kind} " in text) for text in told]
    assert list(dict.fromkeys(kinds)) == list(KINDS)
    assert kinds == sorted(kinds, key=KINDS.index)
    assert {text.rpartition(" ")[2] for text in told} <= {"0%", "25%", "50%", "75%"}
    p, d, angle = found["ATC_RAT_RLL_P"], found["ATC_RAT_RLL_D"], found["ATC_ANG_RLL_P"]
    cut = [math.floor(1e3 * p) / 1e3, math.floor(1e4 * d) / 1e4]  # numbers below 1, as ArduPilot prints them
    assert [text for severity, text in said if severity == 5] == [
        "AutoTune: Roll complete",
        f"AutoTune: Roll Rate: P:{cut[0]:.3f}, I:{cut[0]:.3f}, D:{cut[1]:.4f}",
        f"AutoTune: Roll Angle P:{angle:.3f}, Max Accel:{found['ATC_ACCEL_R_MAX']:.0f}",
        "AutoTune: Success",
    ]


def test_each_twitch_is_that_of_arducopter_on_this_body(roll: Roll) -> None:
    """Recorded from ArduCopter 4.7-dev on the same body, by the external interface with steps of 1.25 ms.

    Its texts at the end: Rate: P:0.227, I:0.227, D:0.0061 and Angle P:21.276, Max Accel:158609.
    """
    head, _, *lines = (RECORDINGS / "autotune_roll.csv").read_text().splitlines()
    recorded = json.loads(head[2:])
    rows = np.array([[float(value) for value in line.split(",")] for line in lines])
    ours = roll.tune.table()
    assert len(ours) == len(rows)
    assert np.array_equal(ours[:, 1:3], rows[:, 1:3])
    assert roll.tune.twitches == recorded["twitches"]
    np.testing.assert_allclose(ours[:, 0], rows[:, 0], atol=0.1)
    tolerances = np.array([0.025, 0.025, 0.025, 1e-4, 1e-4, 1e-4, 0.05])
    alike = (np.abs(ours[:, 3:] - rows[:, 3:]) <= tolerances * np.abs(rows[:, 3:])).all(axis=1)
    assert np.count_nonzero(~alike) <= 6  # a bounce-back at its threshold may count a twitch later
    assert alike[-40:].all()
    last = roll.records[1]["tuned"]  # as a log tells it: number, axis, kind; degrees, gains, centidegrees
    assert last[:2].tolist() == [len(rows), 0.0]
    told = [*np.degrees(last[3:6]), *last[6:9], 100.0 * np.degrees(last[9])]
    np.testing.assert_allclose(told, ours[-1, 3:], rtol=1e-9)
    assert roll.tune.duration == pytest.approx(recorded["duration"], abs=0.1)
    assert "Rate: P:0.227, I:0.227, D:0.0061, Angle P:21.276, Max Accel:" in roll.tune.gains(0)
    assert roll.found["ATC_ACCEL_R_MAX"] == pytest.approx(158609.0, rel=0.005)


def twitch(found: dict[str, float], demand: Callable[[float], float], duration: float) -> NDArray[np.float64]:
    """Roll and its rate [rad, rad/s] while `demand(roll)` [rad/s] is demanded of the rate controller alone."""
    copter = flown_with(found)
    rows = np.empty((round(duration / H), 2))
    for row in rows:
        roll = math.radians(lean(copter)[0])
        row[:] = roll, copter.v["angular_velocity"][0]
        copter.m["rate_wanted"][:] = demand(roll), 0.0, 0.0
        copter.tick()
    return rows


def flown_with(found: dict[str, float]) -> Copter:
    """Level in the air with these gains, without a filter of the target, and with little integral, as in a twitch."""
    given = {**RECORDED_AUTOPILOT, **found, "ATC_RAT_RLL_FLTT": 0.0, "ATC_RAT_RLL_I": 0.01 * found["ATC_RAT_RLL_P"]}
    return Delayed(autopilot=given, vehicle=preset("ardupilot_json")).in_the_air(10.0, 12.0)


def test_a_rate_step_reaches_its_target_after_the_tune_and_hardly_bounces(roll: Roll) -> None:
    """The criteria of the tune, measured apart from it: peak beyond the target, then within AUTOTUNE_AGGR (0.075)."""
    target = math.radians(80.0)
    old = twitch(BEFORE, lambda _: target, 0.25)[:, 1]
    new = twitch(roll.found, lambda _: target, 0.25)[:, 1]
    assert old.max() < target < new.max() < 1.15 * target
    risen = [int(np.argmax(rate > 0.6321 * target)) for rate in (old, new)]
    assert risen[1] < risen[0]
    peak = int(np.argmax(new))
    assert new[peak] - new[peak:].min() < 2.0 * 0.075 * new[peak]


def test_an_angle_step_is_sharp_after_the_tune_and_hardly_overshoots(roll: Roll) -> None:
    target = math.radians(10.0)
    old = twitch(BEFORE, lambda angle: BEFORE["ATC_ANG_RLL_P"] * (target - angle), 1.0)[:, 0]
    gain = roll.found["ATC_ANG_RLL_P"]
    new = twitch(roll.found, lambda angle: gain * (target - angle), 1.0)[:, 0]
    times = [H * int(np.argmax(angle > 0.9 * target)) for angle in (old, new)]
    assert times[1] < 0.5 * times[0]
    assert new.max() < 1.0375 * target
    sharper = twitch(roll.found, lambda angle: 1.5 * gain * (target - angle), 1.0)[:, 0]
    assert sharper.max() > 1.0375 * target  # the tune ended for a reason


@pytest.mark.parametrize(("axes", "name", "row"), [(2, "Pitch", "PIT"), (4, "Yaw(E)", "YAW"), (8, "Yaw(D)", "YAW")])
def test_other_axes_change_only_their_gains(axes: int, name: str, row: str) -> None:
    copter = tuned(axes, LOITER)
    assert (5, f"AutoTune: {name} complete") in texts(copter)
    copter.ask(SET_MODE, 1, ALT_HOLD)
    before = {v: float(copter.m[v]) for v in copter.m.dtype.names if v.startswith("ATC_")}
    copter.ask(AUX, TEST_GAINS, 2)
    changed = {v for v, value in before.items() if copter.m[v] != value}
    tunes = {f"ATC_RAT_{row}_P", f"ATC_RAT_{row}_I", f"ATC_ANG_{row}_P", f"ATC_ACCEL_{row[0]}_MAX"}
    assert changed == tunes | {f"ATC_RAT_{row}_{'FLTE' if axes == 4 else 'D'}"}
    assert np.linalg.norm(copter.v["position"][:2]) < 2.0  # from LOITER, the place is held


def test_far_from_its_place_it_leans_back_and_turns_across() -> None:
    """0.5 deg/m towards the place, at most 10; from 5 m on, the nose is along the way, for pitch across it."""
    copter = in_autotune(2, LOITER)
    copter.m["tune_placed"] = True
    north, east = (float(x) for x in copter.v["position"][:2])
    copter.m["tune_place"][:] = north - 8.0, east
    copter.tick()
    assert np.degrees(copter.m["tune_lean"]) == pytest.approx([0.0, 4.0, 90.0], abs=0.2)
    hold(copter, 4.0, *CENTRED)
    assert math.degrees(copter.m["tune_lean"][0]) > 1.0  # across now: by roll
    nose = rotate(tuple(copter.v["attitude"]), (1.0, 0.0, 0.0))
    assert nose[1] > 0.95  # the nose is to the east
    assert copter.v["position"][0] < north - 1.0


# ---- saving --------------------------------------------------------------------------------------------------------


def land(copter: Copter) -> None:
    """Land with the throttle closed."""
    for _ in range(80):
        hold(copter, 0.5, 1500, 1500, 1000, 1500)
        if not copter.m["armed"]:
            hold(copter, 0.5, 1500, 1500, 1000, 1500)
            return
    raise AssertionError("armed for 40 s")


def again(roll: Roll) -> Copter:
    """After the tune of roll."""
    copter = in_autotune()
    for record, kept in zip((copter.v, copter.m), roll.records, strict=True):
        for name in record.dtype.names:
            record[name] = kept[name]
    copter.step = round(float(copter.m["tune_since"]) / H) + 200
    copter.heard.clear()
    return copter


def test_disarming_in_the_mode_saves_the_gains(roll: Roll) -> None:
    copter = again(roll)
    new = list(roll.found.values())
    assert copter.ask(SET_MODE, 1, ALT_HOLD) == [*DONE, STOPPED]
    testing = copter.ask(SET_MODE, 1, AUTOTUNE)
    assert testing == [*DONE, ("TEXT", 5, "AutoTune: Pilot Testing gains for Roll ")]
    hold(copter, 0.5, *CENTRED)
    assert gains(copter) == new
    land(copter)
    said = [text for _, text in texts(copter)]
    assert said[-2:] == ["Disarming motors", "AutoTune: Saved gains for Roll "]
    assert gains(copter) == new != OLD
    told = [(m.param_id, m.param_index) for m in copter.messages("PARAM_VALUE")]
    names = [f"ATC_RAT_RLL_{gain}" for gain in ("P", "I", "D", "FF", "FLTT", "FLTE", "FLTD")]
    assert told == [(name, 65535) for name in [*names, "ATC_ANG_RLL_P", "ATC_ACCEL_R_MAX"]]
    values = {m.param_id: m.param_value for m in copter.messages("PARAM_VALUE")}
    assert [values[name] for name in BEFORE] == pytest.approx(new, rel=1e-6)
    answer = copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert answer[1] == ("TEXT", 2, "Arm: AUTOTUNE mode not armable")
    assert copter.ask(SET_MODE, 1, STABILIZE) == [*DONE, STOPPED]
    assert gains(copter) == new


def test_disarming_in_another_mode_discards_them(roll: Roll) -> None:
    copter = again(roll)
    copter.ask(SET_MODE, 1, ALT_HOLD)
    copter.ask(SET_MODE, 1, AUTOTUNE)
    hold(copter, 0.5, *CENTRED)
    assert gains(copter) != OLD
    assert copter.ask(SET_MODE, 1, ALT_HOLD) == [*DONE, STOPPED]
    assert gains(copter) == OLD
    land(copter)
    assert gains(copter) == OLD
    assert not any("Saved" in text for _, text in texts(copter))
    assert copter.messages("PARAM_VALUE") == []
    assert copter.ask(AUX, TEST_GAINS, 2)[1] == ("TEXT", 5, "AutoTune: must be complete to test gains")


@pytest.mark.parametrize("position", [0, 2])
def test_the_switch_of_the_gains_decides_what_is_saved(roll: Roll, position: int) -> None:
    copter = again(roll)
    copter.ask(SET_MODE, 1, ALT_HOLD)
    assert copter.ask(AUX, TEST_GAINS, 2)[1] == ("TEXT", 5, "AutoTune: Pilot Testing gains for Roll ")
    new = gains(copter)
    assert new != OLD
    if position == 0:
        assert copter.ask(AUX, TEST_GAINS, 0)[1] == ("TEXT", 5, "AutoTune: original gains restored")
        assert gains(copter) == OLD
    land(copter)
    assert ("AutoTune: Saved gains for Roll " in [text for _, text in texts(copter)]) == (position == 2)
    assert gains(copter) == (new if position == 2 else OLD)
