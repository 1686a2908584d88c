"""When the autopilot speaks: HEARTBEAT once a second and at every change, streams at the rates asked for.

Kernels over the autopilot's record `m`. Rates are those of the SR0_ parameters until REQUEST_DATA_STREAM or
SET_MESSAGE_INTERVAL change them. What is said is in `copter_messages`.

Source: ArduPilot, GCS_Common and GCS_MAVLink_Copter (stream groups).
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.copter_messages import home_ready, send_heartbeat, send_home, send_message, send_origin
from cosim_models.file_transfer import continue_burst
from cosim_models.missions import continue_upload
from cosim_models.parameters import PARAMETER_COUNT, send_list
from cosim_models.streams import HEARTBEAT_ROW, STREAM_COUNT, stream_group
from cosim_models.texts import DISARMING, INFO, NO_NUMBER, say, send_texts

__all__ = ["default_interval", "set_interval", "start_streams", "telemetry"]

_SLACK = 1e-9  # s


@kernel
def default_interval(m: Any, row: int) -> float:
    """Interval [s] that the SR0_ parameters ask for; 0: not sent. HEARTBEAT: 1 s."""
    group = stream_group(row)
    rate = 0
    if row == HEARTBEAT_ROW:
        rate = 1
    elif group == 1:
        rate = m.SR0_RAW_SENS
    elif group == 2:
        rate = m.SR0_EXT_STAT
    elif group == 3:
        rate = m.SR0_RC_CHAN
    elif group == 6:
        rate = m.SR0_POSITION
    elif group == 10:
        rate = m.SR0_EXTRA1
    elif group == 11:
        rate = m.SR0_EXTRA2
    elif group == 12:
        rate = m.SR0_EXTRA3
    return 1.0 / rate if rate > 0 else 0.0


@kernel
def start_streams(m: Any) -> None:
    """All streams at the rates of the parameters; the first HEARTBEAT at once."""
    for row in range(STREAM_COUNT):
        m.interval[row] = default_interval(m, row)
        m.due[row] = m.interval[row]
    m.due[HEARTBEAT_ROW] = 0.0
    m.next_due = 0.0


@kernel
def set_interval(m: Any, row: int, interval: float, t: float) -> None:
    """Stream a row every `interval` s from now on, the first after one interval; 0 stops it."""
    if interval != m.interval[row]:
        m.interval[row] = interval
        m.due[row] = t + interval
    m.next_due = min(m.next_due, m.due[row])


@kernel
def telemetry(m: Any, t: float) -> None:
    """Send what is due at t."""
    if m.told_armed and not m.armed:
        say(m, INFO, DISARMING, NO_NUMBER)
    if (home_ready(m, t) and not m.told_home) or (m.armed and not m.told_armed):
        if not m.armed:
            for i in range(3):
                m.home[i] = m.pos[i]
        m.told_home = send_origin(m, t) and send_home(m, t)
    if m.text_count > 0:
        send_texts(m)
    if m.armed != m.told_armed or m.mode != m.told_mode:
        send_heartbeat(m, t)
        m.told_armed = m.armed
        m.told_mode = m.mode
    if m.parameter_next < PARAMETER_COUNT:
        send_list(m, t)
    if m.file_bursting:
        continue_burst(m, t)
    if m.uploading:
        continue_upload(m, t)
    if t < m.next_due - _SLACK:
        return
    soonest = t + 1.0
    for row in range(STREAM_COUNT):
        if m.interval[row] <= 0.0:
            continue
        if t >= m.due[row] - _SLACK and send_message(m, row, t):
            m.due[row] += m.interval[row]
            if m.due[row] <= t:  # late by more than an interval: do not catch up
                m.due[row] = t + m.interval[row]
        soonest = min(soonest, m.due[row])
    m.next_due = soonest
