"""The names of ports and components by which a master knows what they are, where no model declares it.

Models declare the meaning of their variables (`cosim.verdict`). FMUs of other tools usually do not. For these, a master
infers the meaning from the following names, and from no others:

    AUTOPILOT      the component of a vehicle's system to which a cable connects
    VEHICLE        the component of a vehicle's system whose POSITION is the position of the vehicle
    POSITION       Real output with 3 elements: position of the vehicle, NED from the local origin [m]
    ATTITUDE       Real output with 4 elements: unit quaternion w, x, y, z that rotates body FRD into NED
    STEP, TARGET   outputs of an agent: number of the current step, and desired position in m east of the origin
    LINES          packet ports for ground stations by radio, and for a cable, and for nothing else
"""

from __future__ import annotations

from collections.abc import Mapping

from cosim.verdict import Role

__all__ = ["ATTITUDE", "AUTOPILOT", "LINES", "POSITION", "STEP", "TARGET", "VEHICLE"]

AUTOPILOT, VEHICLE = "autopilot", "vehicle"
POSITION, ATTITUDE = "position", "attitude"
STEP, TARGET = "step", "target"
LINES: Mapping[Role, tuple[str, str]] = {
    Role.TELEMETRY: ("telemetry_rx", "telemetry_tx"),
    Role.SERIAL: ("serial_rx", "serial_tx"),
}
"""Names of the input and of the output."""
