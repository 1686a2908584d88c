"""ArduPilot's firmwares, the frames that they have for our vehicles, and the meaning of their servo outputs.

Source: ArduPilot, FRAME_CLASS and FRAME_TYPE (AP_Motors, Rover), default outputs SERVO1 to SERVO8 of Rover and Plane,
SIM_Rover and SIM_Plane for their directions; Tools/autotest for the files of default parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim.vehicle import MAX_MOTORS, Airframe

__all__ = ["FRAMES", "Firmware", "Frame", "program_of", "put_commands"]


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

    def outputs(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Returns the last two arguments of `put_commands`: channels and commands at rest."""
        rests = [0.5 if i in self.centred else 0.0 for i in range(len(self.channels))]
        return np.array(self.channels), np.array(rests)


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


@kernel
def put_commands(
    motor: NDArray[np.float64], pulses: NDArray[np.uint16], channels: NDArray[np.int64], rests: NDArray[np.float64]
) -> None:
    """Sets the elements of `motor` to servo outputs [us]: (pulse - 1000) / 1000, within 0 and 1.

    A pulse of 0, an output that is off, is rest.

    Args:
        motor: commands; those beyond `channels` are set to 0.
        pulses: servo outputs.
        channels: the output, from 0, of each element.
        rests: the command of an output that is off, by element.
    """
    for i in range(motor.size):
        motor[i] = 0.0
        if i < channels.size:
            pulse = float(pulses[channels[i]]) if channels[i] < pulses.size else 0.0
            motor[i] = min(max((pulse - 1000.0) / 1000.0, 0.0), 1.0) if pulse > 0.0 else rests[i]


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
