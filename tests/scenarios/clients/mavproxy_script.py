"""A MAVProxy module that runs commands from a file, one after the other, each once its condition holds.

A line: SECONDS CONDITION | COMMAND, the condition an expression over `mode`, `armed`, `height` [m], `fix`, `flags`
(of EKF_STATUS_REPORT); SECONDS is how long it may take. When all is done, or something took too long, MAVProxy ends;
what was waited for is in a file. MAVPROXY_SCRIPT and MAVPROXY_LOG name the files.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from MAVProxy.modules.lib import mp_module


class Script(mp_module.MPModule):  # type: ignore[misc]
    def __init__(self, mpstate: Any) -> None:
        super().__init__(mpstate, "mavproxy_script", "commands from a file")
        self.lines = Path(os.environ["MAVPROXY_SCRIPT"]).read_text().splitlines()
        self.log = Path(os.environ["MAVPROXY_LOG"])
        self.seen: dict[str, Any] = {"mode": "", "armed": False, "height": 0.0, "fix": 0, "flags": 0, "north": 0.0}
        self.texts: list[str] = []
        self.since = time.monotonic()

    def mavlink_packet(self, m: Any) -> None:
        kind = m.get_type()
        if kind == "HEARTBEAT" and m.autopilot == 3:
            self.seen["armed"] = bool(m.base_mode & 128)
            self.seen["mode"] = self.master.flightmode
        elif kind == "GLOBAL_POSITION_INT":
            self.seen["height"] = m.relative_alt * 1e-3
            self.seen["lat"], self.seen["lon"] = m.lat * 1e-7, m.lon * 1e-7
        elif kind == "GPS_RAW_INT":
            self.seen["fix"] = m.fix_type
        elif kind == "EKF_STATUS_REPORT":
            self.seen["flags"] = m.flags
        elif kind == "PARAM_VALUE":
            self.seen[f"param_{m.param_id}"] = m.param_value
        elif kind in ("MISSION_ACK", "MISSION_CURRENT", "MISSION_COUNT"):
            self.seen[kind] = m.to_dict()

    def idle_task(self) -> None:
        if not self.lines:
            return
        limit, _, rest = self.lines[0].partition(" ")
        condition, _, command = rest.partition(" | ")
        known = {f"param_{name}": value for name, value in self.mav_param.items()}  # fetched as a file or one by one
        try:
            holds = bool(eval(condition, {"abs": abs}, {**known, **self.seen}))
        except NameError:
            holds = False
        if holds:
            self._write(f"done: {command}")
            self.lines.pop(0)
            self.since = time.monotonic()
            if command == "end":
                os._exit(0)
            self.mpstate.functions.process_stdin(command)
        elif time.monotonic() - self.since > float(limit):
            self._write(f"failed: {self.lines[0]}: {self.seen}")
            os._exit(1)

    def _write(self, text: str) -> None:
        with self.log.open("a") as file:
            file.write(text + "\n")


def init(mpstate: Any) -> Script:
    return Script(mpstate)
