"""ArduPilot itself in the place of `Autopilot` in a `Copter`: the same questions, the same moves, without a master."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.vehicle import Airframe
from cosim_models.ardupilot.firmware import FRAMES, program_of
from cosim_models.ardupilot.sitl import ArduPilotSITL, _defaults
from cosim_models.vehicles.quadrotor import Quadrotor
from tests.models.copter import MOTION, Copter, Decoder, set_values

H = 0.001
"""Steps [s] of both, if no others are asked for: ArduCopter refuses a gyro slower than 1.8 times its loop of 400 Hz."""
READY = 45.0
"""When [s] its position estimate is there, some seconds after the 42 s it takes."""


class RealCopter(Copter):
    """A flight of the program that ARDUPILOT_SITL names, in `folder`.

    Args:
        folder: its working directory: parameters, logs, what it prints.
        vehicle: parameters of the quadrotor.
        parameters: of ArduCopter, for its start.
        instance: number of ports; not that of any other that runs.
        attach: to one that runs.
        model: the vehicle, which determines the firmware; its program lies beside the one of ARDUPILOT_SITL.
        step: duration of a step of both [s].
    """

    def __init__(
        self,
        folder: Path,
        vehicle: dict[str, Any],
        parameters: dict[str, float] | None = None,
        instance: int = 210,
        attach: bool = False,
        model: Any = Quadrotor,
        step: float = H,
    ) -> None:
        self.h = step
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "test.parm").write_text("".join(f"{name} {value}\n" for name, value in (parameters or {}).items()))
        self.system, self.step = 1, 0
        self.waiting, self.heard, self.sent = b"", [], bytearray()
        self._decoder = Decoder()
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.v = model.record()
        set_values(self.v, vehicle)
        self.start_vehicle, self.advance_vehicle = model.kernels
        assert self.start_vehicle(self.v) == 0
        self.slave: Any = ArduPilotSITL(instance_name="autopilot")
        self.m = self.slave.m
        self.m["instance"], self.m["attach"], self.m["airframe"] = instance, attach, self.v["airframe"]
        firmware = FRAMES[Airframe(int(self.v["airframe"]))].firmware
        program = program_of(firmware, Path(os.environ["ARDUPILOT_SITL"]).resolve())
        files = [*_defaults("", program, firmware), folder / "test.parm"]
        self.slave.strings |= {"folder": str(folder), "defaults": ",".join(map(str, files))}
        self.slave.setup_experiment(0.0, None, None)
        self.slave.enter_initialization_mode()
        self._pairs = [(self.m[name], self.v[name]) for name in MOTION]
        self._commands, self._motor = self.v["motor"], self.m["motor"]
        self._connect()
        self.slave.exit_initialization_mode()

    @property
    def time(self) -> float:
        return self.step * self.h

    def tick(self) -> None:
        m, t = self.m, self.step * self.h
        command = self._motor.copy()
        self._connect()
        data, self.waiting = self.waiting, b""
        m["mavlink_rx"][: len(data)] = np.frombuffer(data, dtype=np.uint8)
        m["mavlink_rx_len"] = len(data)
        assert self.slave.do_step(t, self.h)
        self.slave.get_real([])
        self._commands[:] = command
        assert self.advance_vehicle(self.v, t, self.h) == 0
        if used := int(m["mavlink_tx_len"]):
            data = m["mavlink_tx"][:used].tobytes()
            self.sent += data
            self.heard += [(t, message) for message in self._decoder(data)]
        self.step += 1

    def run(self, duration: float) -> NDArray[np.float64]:
        """Fly on; rows of time [s], position [m, NED], velocity [m/s, NED], attitude (w, x, y, z)."""
        rows = np.empty((round(duration / self.h), 11))
        position, velocity, attitude = self.v["position"], self.v["velocity"], self.v["attitude"]
        for row in rows:
            self.tick()
            row[0] = self.step * self.h
            row[1:4], row[4:7], row[7:11] = position, velocity, attitude
        return rows

    def ask(self, number: int, *parameters: float, **options: Any) -> list[tuple[str, Any, Any]]:
        self.answers()
        self.command(number, *parameters, **options)
        self.run(0.1)  # its serial ports have their turn every 10 ms
        return self.answers()

    def close(self) -> None:
        self.slave.terminate()
