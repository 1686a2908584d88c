"""A MAVProxy module that runs common commands of its modules one after the other, and writes their outcomes as JSON.

An outcome is that which the vehicle answers within SETTLE seconds, once for each kind: acknowledgements with their
results, texts, other answers to commands, modes and arming. A command may wait for a condition over `mode`, `armed`,
`height` [m], `ready`. MAVPROXY_OUTCOMES names the file, MAVPROXY_FOLDER the folder of the plans.
"""

from __future__ import annotations

import json
import os
import re
import time
from pathlib import Path
from typing import Any

from MAVProxy.modules.lib import mp_module
from pymavlink import mavutil

SETTLE, PATIENCE, MOST = 2.0, 60.0, 20.0
"""Seconds after a command by the vehicle's clock, for a condition by ours, and for a vehicle that does not answer."""
ROUNDS, LONGER = 3, 15
"""TIMESYNCs after a command, each sent when the one before is answered; more where a protocol has many messages."""
PROTOCOLS = ("wp", "fence", "rally", "ftp", "log", "param")
ANSWERS = {"LOG_ENTRY", "AUTOPILOT_VERSION", "HOME_POSITION", "MISSION_COUNT", "TERRAIN_REPORT", "GPS_GLOBAL_ORIGIN"}
UNASKED = ("PreArm", "EKF3", "SIM ", "AHRS", "GPS ", "RC7: ")
"""Texts that come by themselves; one of the banner's lines names the machine, and RC7 is a switch of copter.parm."""
GROUND = """
param fetch
param show WPNAV_SPEED
param set WPNAV_SPEED 900
param set NO_SUCH 1
version
capabilities
gethome
arm check all
arm uncheck all
arm check all
arm prearms
mode ALT_HOLD
mode LOITER
mode POSHOLD
mode ACRO
mode SPORT
mode FLIP
mode AUTOTUNE
mode DRIFT
mode BRAKE
mode CIRCLE
mode SMART_RTL
mode FOLLOW
mode AUTO
mode 99
mode STABILIZE
rc 3 1500
rc all 1500
rc clear
switch 4
switch 0
relay set 0 1
relay set 5 1
relay repeat 0 2 1
servo set 9 1700
servo set 1 1700
servo repeat 9 1700 2 1
motortest 1 0 5 1 0
wp load FOLDER/mission
wp list
wp set 2
wp update FOLDER/mission 1
wp save FOLDER/saved
wp sethome
wp ftp FOLDER/got
wp clear
wp list
wp load FOLDER/mission
fence load FOLDER/fence
fence list
fence enable
fence disable
fence clear
fence list
rally load FOLDER/rally
rally list
rally clear
log list
log download 1 FOLDER/log.bin
log erase
log resume
ftp list
ftp list @PARAM
ftp list /nowhere
ftp get @PARAM/param.pck FOLDER/param.pck
ftp crc /nowhere
gimbal mode MAVLink
gimbal angle 0 -20 0
gimbal rate 0 0 5
gimbal roi -35.3632 149.1653 10
gimbal roivel 1 0 0
terrain status
terrain check -35.363262 149.165237
"""
FLIGHT = """
mode GUIDED
arm throttle
takeoff 10
height > 9 | guided -35.3632 149.1653 40
height > 39 | setspeed 3
setyaw 90 10 0
velocity 1 0 0
position 0 5 0
attitude 1 0 0 0 0.5
posvel -35.3632 149.1653 40 0 0 0
guided 40
guided forward 3
changealt 41
motortest 1 0 5 1 0
log list
disarm
gyrocal
wp list
fence load FOLDER/fence
fence enable
fence disable
fence clear
mode AUTO
pause
resume
wp set 3
mode CIRCLE
mode GUIDED
mode BRAKE
mode FLIP
mode AUTOTUNE
mode THROW
mode ZIGZAG
mode GUIDED
mode ALT_HOLD
mode GUIDED
mode LOITER
mode GUIDED
long MAV_CMD_DO_SET_MODE 1 9
mode SMART_RTL
mode GUIDED
mode RTL
rtl
land
not armed | arm throttle
mode GUIDED
mode STABILIZE
"""
LATER = """
ground
level
calpress
gyrocal
accelcalsimple
ahrstrim
magcal start
magcal accept
magcal cancel
magcal yaw 90
forcecal both
messagerate set ATTITUDE 5
messagerate get ATTITUDE
long REQUEST_MESSAGE 30
long MAV_CMD_DO_SET_ROI_NONE
long 31010
command_int 3 MAV_CMD_DO_SET_ROI_LOCATION 0 0 0 0 0 0 -353632000 1491653000 5
command_int GLOBAL_RELATIVE_ALT NAV_TAKEOFF 0 0 0 0 0 0 0 0 10
message TERRAIN_CHECK -353632620 1491652370
message SET_MODE 1 1 0
cammsg
camctrlmsg
parachute enable
parachute release
engine 1
engine 0
pause
resume
playtune AAA
led 255 0 0
oreoled 0 255 0 0
rcbind 0
batreset 1
setorigin -35.363262 149.165237 584
magsetfield 100 0 400
magresetofs
scripting stop
formatsdcard
canforward 0
gear up
namedvaluefloat X 1
devid
ping
setspeed 3
setyaw 90 10 0
velocity 1 0 0
takeoff 10
land
disarm
mode STABILIZE
arm throttle
disarm
arm throttle force
disarm force
reboot
"""


class Calls(mp_module.MPModule):  # type: ignore[misc]
    """Runs the commands."""

    def __init__(self, mpstate: Any) -> None:
        super().__init__(mpstate, "mavproxy_calls", "common commands of all modules")
        folder = os.environ["MAVPROXY_FOLDER"]
        self.lines = [line.replace("FOLDER", folder) for line in (GROUND + FLIGHT + LATER).splitlines() if line]
        self.file = Path(os.environ["MAVPROXY_OUTCOMES"])
        self.seen: dict[str, Any] = {"mode": "", "armed": False, "height": 0.0, "ready": 0}
        self.since, self.command = time.monotonic(), ""
        self.clock = self.began = 0.0
        self.rounds, self.mark = 0, 1000
        self.heard: dict[str, None] = {}
        self.folder = folder
        self.ready = False

    def mavlink_packet(self, m: Any) -> None:
        kind = m.get_type()
        self.clock = getattr(m, "time_boot_ms", 0) * 1e-3 or self.clock
        if kind == "HEARTBEAT" and m.autopilot == 3:
            mode, armed = self.master.flightmode, bool(m.base_mode & 128)
            if self.command and mode != self.seen["mode"]:
                self.heard[f"mode {mode}"] = None
            if self.command and armed != self.seen["armed"]:
                self.heard["armed" if armed else "disarmed"] = None
            self.seen |= {"mode": mode, "armed": armed}
        elif kind == "GLOBAL_POSITION_INT":
            self.seen["height"] = m.relative_alt * 1e-3
        elif kind == "EKF_STATUS_REPORT":
            self.seen["ready"] = m.flags & 512
        elif kind == "TIMESYNC" and m.ts1 == self.mark and m.tc1 != 0 and self.rounds > 0:
            self.rounds -= 1
            if self.rounds > 0:
                self._ping()
        elif kind == "COMMAND_ACK":
            enums = mavutil.mavlink.enums
            name = enums["MAV_CMD"][m.command].name if m.command in enums["MAV_CMD"] else str(m.command)
            result = enums["MAV_RESULT"][m.result].name if m.result in enums["MAV_RESULT"] else str(m.result)
            self.heard[f"{name.removeprefix('MAV_CMD_')} {result.removeprefix('MAV_RESULT_')}"] = None
        elif kind == "MISSION_ACK":
            self.heard[f"MISSION_ACK {m.type}"] = None
        elif kind == "STATUSTEXT":
            if not m.text.startswith(UNASKED) and not re.search("[0-9a-f]{20}", m.text):
                self.heard[f'"{m.text}"'] = None
        elif kind in ANSWERS and (kind != "TERRAIN_REPORT" or self.command.startswith(("terrain", "message"))):
            self.heard[kind] = None

    def idle_task(self) -> None:
        now = time.monotonic()
        if not self.ready:
            self.ready = bool(self.seen["ready"]) and now - self.since > 20.0
            return
        if self.command:
            if (self.rounds == 0 and self.clock >= self.began + SETTLE) or now - self.since > MOST:
                self._tell(sorted(self.heard))
            return
        if not self.lines:
            os._exit(0)
        condition, bar, command = self.lines[0].rpartition(" | ")
        holds = not bar or bool(eval(condition, {}, dict(self.seen)))
        if holds or now - self.since > PATIENCE:
            self.lines.pop(0)
            self.since, self.command, self.began = now, command, self.clock
            self.heard = {}
            if not holds:
                self.heard[f"({condition} has not come)"] = None
            self.mpstate.functions.process_stdin(command)
            self.rounds = LONGER if command.startswith(PROTOCOLS) else ROUNDS
            self._ping()

    def _ping(self) -> None:
        """Asks something that is answered after all that was asked before."""
        self.mark += 1
        self.master.mav.timesync_send(0, self.mark)

    def _tell(self, heard: list[str]) -> None:
        line = {"call": self.command.replace(self.folder + "/", ""), "outcome": "; ".join(heard)}
        with self.file.open("a") as file:
            file.write(json.dumps(line) + "\n")
        self.since, self.command = time.monotonic(), ""


def init(mpstate: Any) -> Calls:
    return Calls(mpstate)
