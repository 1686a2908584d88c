"""ArduPilot's firmwares, the frames that they have for our vehicles, and the meaning of their servo outputs.

Source: ArduPilot, FRAME_CLASS and FRAME_TYPE (AP_Motors, Rover), default outputs SERVO1 to SERVO8 of Rover and Plane,
SIM_Rover and SIM_Plane for their directions; Tools/autotest for the files of default parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.vehicle import MAX_MOTORS, Airframe

__all__ = ["FRAMES", "Firmware", "Frame", "commands_of", "program_of"]


@dataclass(frozen=True, slots=True)
class Firmware:
    """One of ArduPilot's programs.

    Attributes:
        name: as ArduPilot writes it.
        program: file name.
        defaults: files of its default parameters in ArduPilot's Tools/autotest, of which the first that exists counts.
        loop: rate of its main loop by default [Hz].
        channels: the servo output, from 0, of each element of `motor`.
        centred: elements of `motor` that rest at 0.5.
        flies: whether it can be off the ground.
    """

    name: str
    program: str
    defaults: tuple[str, ...]
    loop: float
    channels: tuple[int, ...]
    centred: tuple[int, ...] = ()
    flies: bool = True


@dataclass(frozen=True, slots=True)
class Frame:
    """The firmware for an airframe, and the parameters that select the frame, as lines of a parameter file."""

    firmware: Firmware
    parameters: str = ""


_COPTER = Firmware("ArduCopter", "arducopter", ("default_params/copter.parm",), 400.0, tuple(range(MAX_MOTORS)))
_ROVER = Firmware("ArduRover", "ardurover", ("default_params/rover.parm",), 50.0, (0, 2), (0, 1), flies=False)
_PLANE = Firmware(
    "ArduPlane", "arduplane", ("default_params/plane.parm", "models/plane.parm"), 50.0, (0, 1, 2, 3), (0, 1, 3)
)
_QUADPLANE = Firmware(
    "ArduPlane", "arduplane", ("default_params/quadplane.parm",), 300.0, tuple(range(MAX_MOTORS)), (0, 1, 3)
)


def _copter(frame_class: int, frame_type: int) -> Frame:
    return Frame(_COPTER, f"FRAME_CLASS {frame_class}\nFRAME_TYPE {frame_type}\n")


FRAMES: Mapping[Airframe, Frame] = {
    Airframe.quad_x: _copter(1, 1),
    Airframe.hexa_x: _copter(2, 1),
    Airframe.octa_x: _copter(3, 1),
    Airframe.y6: _copter(5, 10),
    Airframe.quad_plus: _copter(1, 0),
    Airframe.rover: Frame(_ROVER, "FRAME_CLASS 1\n"),
    Airframe.boat: Frame(_ROVER, "FRAME_CLASS 2\n"),
    Airframe.plane: Frame(_PLANE),
    Airframe.quadplane: Frame(_QUADPLANE, "Q_ENABLE 1\nQ_FRAME_CLASS 1\nQ_FRAME_TYPE 1\n"),
}


def commands_of(firmware: Firmware, pulses: Sequence[int]) -> list[float]:
    """Returns the elements of `motor` for servo outputs [us]: (pulse - 1000) / 1000, within 0 and 1.

    A pulse of 0, an output that is off, is rest.
    """
    found = [0.0] * MAX_MOTORS
    for i, channel in enumerate(firmware.channels):
        pulse = pulses[channel] if channel < len(pulses) else 0
        rest = 0.5 if i in firmware.centred else 0.0
        found[i] = min(max((pulse - 1000) / 1000.0, 0.0), 1.0) if pulse > 0 else rest
    return found


def program_of(firmware: Firmware, given: Path) -> Path:
    """Returns the program of a firmware: the given one, or the one beside it if that is of another firmware.

    Raises:
        RuntimeError: the given program is of another firmware, and there is none of this one beside it.
    """
    others = {frame.firmware.program: frame.firmware.name for frame in FRAMES.values()} | {"ardusub": "ArduSub"}
    other = others.get(given.stem.lower())
    if other is None or other == firmware.name:
        return given
    beside = given.with_name(firmware.program + given.suffix)
    if not beside.is_file():
        raise RuntimeError(
            f"{given} is {other}, but this vehicle needs {firmware.name}, and there is no {beside}; set `executable`"
        )
    return beside
