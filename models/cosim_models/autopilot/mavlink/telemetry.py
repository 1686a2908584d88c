"""Timing of the autopilot's messages: HEARTBEAT once a second and at every change, streams at the requested rates.

Kernels over the autopilot's record `m`. Every link has its own streams, at the rates of its parameters (SR2_ on board
and by the swarm's radio, SR1_ by the ground stations' radio, SR0_ by cable), until a REQUEST_DATA_STREAM or
SET_MESSAGE_INTERVAL received on that link changes them. The contents are in `messages`.

Source: ArduPilot, GCS_Common and GCS_MAVLink_Copter (stream groups).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.fields import get_whole
from cosim.kernel import kernel
from cosim.model import record_layout
from cosim_models.autopilot.commander.readiness import home_ready
from cosim_models.autopilot.flight.state import reported_mode
from cosim_models.autopilot.flight.tuning.autotune import settle_tune
from cosim_models.autopilot.link.links import LINKS
from cosim_models.autopilot.link.statustext import DISARMING, ELEVATION, INFO, NO_NUMBER, say, send_texts
from cosim_models.autopilot.mavlink.file_transfer import continue_burst
from cosim_models.autopilot.mavlink.messages import send_heartbeat, send_home, send_message, send_origin
from cosim_models.autopilot.mavlink.parameters import PARAMETER_COUNT, send_list, tell_saved
from cosim_models.autopilot.mission.missions import continue_upload
from cosim_models.autopilot.record.modes import AUTOTUNE
from cosim_models.autopilot.record.parameters import STREAM_RATES
from cosim_models.autopilot.record.streams import HEARTBEAT_ROW, STREAM_COUNT, stream_group
from cosim_models.autopilot.record.variables import VARIABLES

__all__ = ["default_interval", "set_interval", "start_streams", "telemetry"]

_SLACK = 1e-9  # s

_FIELDS = record_layout(VARIABLES)[0].fields
assert _FIELDS is not None
_GROUPS = 13  # MAV_DATA_STREAMs
_RATES = np.array(
    [
        [_FIELDS[STREAM_RATES[link, group]][1] if (link, group) in STREAM_RATES else 0 for group in range(_GROUPS)]
        for link in range(LINKS)
    ],
    dtype=np.int64,
)
"""Offset of the rate parameter of a group on a link, 0 if there is none."""


@kernel
def default_interval(m: Any, row: int) -> float:
    """Returns the interval [s] given by the parameters of m.link; 0: not sent. HEARTBEAT: 1 s."""
    if row == HEARTBEAT_ROW:
        return 1.0
    offset = _RATES[m.link, stream_group(row)]
    rate = get_whole(m, offset) if offset != 0 else 0
    return 1.0 / rate if rate > 0 else 0.0


@kernel
def start_streams(m: Any) -> None:
    """Starts all streams of all links at the parameters' rates, with the first HEARTBEAT at once and no list in
    progress.
    """
    for link in range(LINKS):
        m.link = link
        m.link_version[link] = 2
        m.parameter_next[link] = PARAMETER_COUNT
        for row in range(STREAM_COUNT):
            m.interval[link, row] = default_interval(m, row)
            m.due[link, row] = m.interval[link, row]
        m.due[link, HEARTBEAT_ROW] = 0.0
        m.next_due[link] = 0.0
    m.soonest_due = 0.0


@kernel
def set_interval(m: Any, row: int, interval: float, t: float) -> None:
    """Streams a row every `interval` s on m.link from now on, first after one interval; 0 stops it."""
    link = m.link
    if interval != m.interval[link, row]:
        m.interval[link, row] = interval
        m.due[link, row] = t + interval
    m.next_due[link] = min(m.next_due[link], m.due[link, row])
    m.soonest_due = min(m.soonest_due, m.next_due[link])


@kernel
def _stream(m: Any, t: float) -> None:
    """Sends the messages due at t on m.link."""
    link = m.link
    soonest = t + 1.0
    for row in range(STREAM_COUNT):
        interval = m.interval[link, row]
        if interval <= 0.0:
            continue
        if t >= m.due[link, row] - _SLACK and send_message(m, row, t):
            m.due[link, row] += interval
            if m.due[link, row] <= t:  # late by more than an interval: skip the missed ones
                m.due[link, row] = t + interval
        soonest = min(soonest, m.due[link, row])
    m.next_due[link] = soonest


@kernel
def _tell_home(m: Any, t: float) -> None:
    """Sends home and origin on every link when they become known and at arming."""
    if not m.armed and not m.home_locked:
        for i in range(3):
            m.home_neu[i] = m.position_neu[i]
    m.mission_count = max(m.mission_count, 1)  # home is item 0
    told = True
    for link in range(LINKS):
        m.link = link
        told = send_origin(m, t) and send_home(m, t) and told
    m.told_home = told
    if m.tells_elevation:
        m.tells_elevation = False
        say(m, INFO, ELEVATION, max(int(m.origin_altitude + m.home_neu[2] + 0.5), 0))


@kernel
def telemetry(m: Any, t: float) -> None:
    """Sends the messages due at t on all links."""
    if m.told_armed and not m.armed:
        say(m, INFO, DISARMING, NO_NUMBER)
        settle_tune(m, m.mode == AUTOTUNE)
    if (home_ready(m, t) and not m.told_home) or (m.armed and not m.told_armed):
        _tell_home(m, t)
    if m.text_count > 0:
        send_texts(m)
    mode = reported_mode(m)
    changed = m.armed != m.told_armed or mode != m.told_mode
    m.told_armed = m.armed
    m.told_mode = mode
    if not (changed or m.transferring) and t < m.soonest_due - _SLACK:
        return
    m.soonest_due = t + 1.0
    m.transferring = m.file_bursting or m.uploading
    if m.tune_unsent != 0:
        tell_saved(m)
        m.transferring = True
    for link in range(LINKS):
        m.link = link
        if changed:
            send_heartbeat(m, t)
        if m.parameter_next[link] < PARAMETER_COUNT:
            send_list(m, t)
            m.transferring = True
        if m.file_bursting and m.file_link == link:
            continue_burst(m, t)
        if m.uploading and m.upload_link == link:
            continue_upload(m, t)
        if t >= m.next_due[link] - _SLACK:
            _stream(m, t)
        m.soonest_due = min(m.soonest_due, m.next_due[link])
