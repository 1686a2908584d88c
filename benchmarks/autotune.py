"""A tune of ArduCopter's AUTOTUNE by ours and, with ARDUPILOT_SITL, by the user's, on the same body: what they find.

Both fly the preset `ardupilot_json`. The motors of the real one's body obey 1.25 ms after a command; those of ours too,
and besides that at once and after 2.5 ms, as with the masters `gauss-seidel` and `jacobi`. For each axis, the table has
the twitches that counted by kind (rate D up, D down, P up, angle P down, up), the gains and the time.

    python -m benchmarks.autotune [--axes 15] [--json FILE]
    ARDUPILOT_SITL=... python -m benchmarks.autotune --axes 1 --folder FOLDER     also writes FOLDER/autotune.csv
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.DFReader import DFReader_binary
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.report import machine, show, write
from tests.models.copter import ACCEPTED, RECORDED_AUTOPILOT, Copter, H, preset
from tests.models.pilot import override
from tests.models.real_copter import READY, RealCopter
from tests.models.shipped_kernels import part

ALT_HOLD, LOITER, AUTOTUNE = 2, 5, 15
AXES = ("roll", "pitch", "yaw (E)", "yaw (D)")
KINDS = (0, 1, 2, 4, 5)
"""Kinds of twitches, as ArduPilot numbers them."""
STEP = 0.00125
"""Steps [s] of the real one's body, two of which are a loop."""
CENTRED = (1500, 1500, 1500, 1500)
LONGEST = 2000.0
"""Time [s] after which a tune is given up."""
COLUMNS = "t,axis,kind,target,least,greatest,rate_p,rate_d,angle_p,accel"


class Delayed(Copter):
    """A `Copter` whose motors obey half a step of the autopilot after a command: 1.25 ms."""

    def __post_init__(self) -> None:
        super().__post_init__()
        advance = self.advance_vehicle

        def twice(vehicle: Any, t: float, h: float) -> int:
            failed = advance(vehicle, t, 0.5 * h)
            self._commands[:] = self.m["motor"]
            return failed or advance(vehicle, t + 0.5 * h, 0.5 * h)

        self.advance_vehicle = twice


@dataclass(slots=True)
class Tune:
    """A tune.

    Attributes:
        rows: for each twitch that counted: time [s], axis, kind, target, least and greatest rate or angle [deg/s, deg],
            rate P and D (yaw (E): filter of the error [Hz]), angle P before it changed them, acceleration [cdeg/s2].
        twitches: number of all twitches; 0: not known.
        duration: time [s].
        texts: all of them with severities.
    """

    rows: list[tuple[float, ...]] = field(default_factory=list)
    twitches: int = 0
    duration: float = 0.0
    texts: list[tuple[int, str]] = field(default_factory=list)

    def table(self) -> NDArray[np.float64]:
        return np.array(self.rows)

    def gains(self, axis: int) -> str:
        """P and D of the rate, P of the angle and the acceleration, as the texts told them."""
        name = ("Roll", "Pitch", "Yaw(E)", "Yaw(D)")[axis]
        told = [text for _, text in self.texts if text.startswith(f"AutoTune: {name} ") and ":" in text[10:]]
        return ", ".join(text.removeprefix(f"AutoTune: {name} ") for text in told)

    def counts(self, axis: int) -> list[int]:
        """Twitches that counted, by kind."""
        return [sum(row[1] == axis and row[2] == kind for row in self.rows) for kind in KINDS]


def _measured(m: Any, t: float) -> tuple[float, ...]:
    """The row of a twitch that has just ended, from the record of ours."""
    by_angle = bool(m["tune_kind"] > 2)
    axis = int(m["tune_axis"])
    peak, least = np.degrees(m["tune_angles"] if by_angle else m["tune_rates"])
    found = m["tune_found"][min(axis, 2)]
    gains = (found[0], found[5 if axis == 2 else 2], found[6])
    target = math.degrees(m["tune_target"][int(by_angle)])
    return t, axis, KINDS[m["tune_kind"]], target, least, peak, *gains, 100.0 * math.degrees(m["tune_accel"])


def fly_ours(copter: Copter) -> Tune:
    """Flies ours, which is in AUTOTUNE, until the tune has ended, with centred sticks."""
    tune, m, step, begin = Tune(), copter.m, 0, copter.time
    stage, at = part(m, "tune_stage"), part(m, "tune_step")
    while stage[0] == 1 and copter.time - begin < LONGEST:
        if copter.step % 200 == 0:
            override(copter, *CENTRED)
        copter.tick()
        now = int(at[0])
        if now == 1 != step:
            tune.twitches += 1
        elif now == 2 != step:
            tune.rows.append(_measured(m, copter.time - begin))
        step = now
    tune.duration = copter.time - begin
    copter.run(2 * H)
    tune.texts = [(message.severity, message.text) for message in copter.messages("STATUSTEXT")]
    return tune


def enter(copter: Any, mode: int) -> None:
    """Enters AUTOTUNE from `mode`, with centred sticks.

    Raises:
        RuntimeError: it is refused.
    """
    override(copter, *CENTRED)
    for number in (mode, AUTOTUNE):
        answers = copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, number)
        if answers[0][2] != ACCEPTED:
            raise RuntimeError(f"mode {number} is refused: {answers}")


def fly_real(folder: Path, axes: int, mode: int) -> Tune:
    """Flies the program that ARDUPILOT_SITL names, and reads its log in `folder`.

    Raises:
        RuntimeError: AUTOTUNE is refused, or has no success within `LONGEST`.
    """
    given = {"AUTOTUNE_AXES": axes, "LOG_DISARMED": 0}
    copter = RealCopter(folder, preset("ardupilot_json"), given, instance=237, step=STEP)
    try:
        copter.run(READY)
        for command in ((176, 1, 4), (400, 1), (22, 0, 0, 0, 0, 0, 0, 10.0)):
            copter.ask(*command)
        copter.run(12.0)
        enter(copter, mode)
        begin = copter.time
        while not any(message.text == "AutoTune: Success" for message in copter.messages("STATUSTEXT")):
            if copter.time - begin > LONGEST:
                raise RuntimeError(f"no success within {LONGEST:g} s; see the log in {folder}")
            override(copter, *CENTRED)
            copter.run(0.5)
        for sticks in itertools.repeat((1500, 1500, 1000, 1500), 60):  # lands, so that the log is complete
            override(copter, *sticks)
            copter.run(0.5)
        texts = [(message.severity, message.text) for message in copter.messages("STATUSTEXT")]
    finally:
        copter.close()
    tune = Tune(texts=texts)
    (log,) = (folder / "logs").glob("*.BIN")
    reader, start, last = DFReader_binary(str(log)), 0.0, -1.0
    while (message := reader.recv_match(type=["ATUN", "ATDE", "EV"])) is not None:
        t, kind = message.TimeUS / 1e6, message.get_type()
        if kind == "EV" and message.Id == 30:  # begun
            start = t
        elif kind == "EV" and message.Id == 33:  # succeeded
            tune.duration = t - start
        elif kind == "ATDE":  # each step of a twitch
            tune.twitches += t - last > 0.1
            last = t
        elif kind == "ATUN":
            names = ("Axis", "TuneStep", "Targ", "Min", "Max", "RP", "RD", "SP", "ddt")
            tune.rows.append((t - start, *(float(getattr(message, name)) for name in names)))
    return tune


def begun(axes: int, mode: int, model: type[Copter] = Delayed, **options: Any) -> Copter:
    """Ours in AUTOTUNE, entered from `mode` 10 m above the ground; `options` are those of `Copter`."""
    given = {"AUTOTUNE_AXES": axes, **RECORDED_AUTOPILOT, **options.pop("autopilot", {})}
    copter = model(autopilot=given, vehicle=preset("ardupilot_json"), **options).in_the_air(10.0, 12.0)
    copter.heard.clear()
    enter(copter, mode)
    return copter


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--axes", type=int, default=15)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    mode = LOITER if options.axes != 1 else ALT_HOLD
    tunes = {
        "ours, 1.25 ms": fly_ours(begun(options.axes, mode)),
        "ours, 2.5 ms": fly_ours(begun(options.axes, mode, Copter)),
        "ours, at once": fly_ours(begun(options.axes, mode, Copter, direct=True)),
    }
    if "ARDUPILOT_SITL" in os.environ and options.folder is not None:
        real = fly_real(options.folder, options.axes, mode)
        tunes = {"ArduCopter": real, **tunes}
        head = {"axes": options.axes, "step": STEP, "duration": round(real.duration, 2), "twitches": real.twitches}
        lines = [",".join(f"{value:.6g}" for value in row) for row in real.rows]
        (options.folder / "autotune.csv").write_text("\n".join((f"# {json.dumps(head)}", COLUMNS, *lines)) + "\n")
    rows = [
        {"axis": name, "tune": who, "twitches": tune.counts(axis), "gains": tune.gains(axis), "time": tune.duration}
        for axis, name in enumerate(AXES)
        if options.axes >> axis & 1
        for who, tune in tunes.items()
    ]
    table = [
        (f"{row['axis']}: {row['tune']}", " ".join(map(str, row["twitches"])), str(row["gains"]), f"{row['time']:.1f}")
        for row in rows
    ]
    note = "twitches that counted, by kind; gains as the texts tell them; time of the whole tune, s"
    host = machine()
    show("AUTOTUNE", host, ("axis: delay of the motors", "twitches", "gains", "time"), table, note)
    write(options.json, host, {"benchmark": "autotune", "rows": rows})


if __name__ == "__main__":
    main()
