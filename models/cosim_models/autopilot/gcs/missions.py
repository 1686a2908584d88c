"""MAVLink's mission protocol for the small autopilots: upload, download, clear, set the current item.

Kernels over a record with `gcs.record.MISSION`. Item 0 is home. Commands that the autopilot cannot carry out are
refused during the upload, as are fences and rally points (MAV_MISSION_UNSUPPORTED), of which the lists are empty.

Sources: the MAVLink guide, "Mission Protocol"; ArduPilot, MissionItemProtocol.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from cosim.frames import deg_e7, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_NAV_LAST,
    MAV_CMD_NAV_WAYPOINT,
    MAV_FRAME_GLOBAL,
    MAV_MISSION_ACCEPTED,
    MAV_MISSION_DENIED,
    MAV_MISSION_ERROR,
    MAV_MISSION_INVALID,
    MAV_MISSION_INVALID_SEQUENCE,
    MAV_MISSION_NO_SPACE,
    MAV_MISSION_OPERATION_CANCELLED,
    MAV_MISSION_TYPE_MISSION,
    MAV_MISSION_TYPE_RALLY,
    MAV_MISSION_UNSUPPORTED,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_WARNING,
    MAV_TYPE_QUADROTOR,
    MISSION_ACK,
    MISSION_CLEAR_ALL,
    MISSION_COUNT,
    MISSION_CURRENT,
    MISSION_ITEM,
    MISSION_ITEM_INT,
    MISSION_ITEM_REACHED,
    MISSION_REQUEST,
    MISSION_REQUEST_INT,
    MISSION_REQUEST_LIST,
    MISSION_SET_CURRENT,
    MISSION_WRITE_PARTIAL_LIST,
    decode_mission_clear_all,
    decode_mission_count,
    decode_mission_item,
    decode_mission_item_int,
    decode_mission_request,
    decode_mission_request_list,
    decode_mission_set_current,
    decode_mission_write_partial_list,
    encode_mission_ack,
    encode_mission_count,
    encode_mission_item,
    encode_mission_item_int,
    encode_mission_item_reached,
    encode_mission_request,
)
from cosim_models.autopilot.gcs.record import MAX_MISSION
from cosim_models.autopilot.gcs.sending import can_answer, send
from cosim_models.autopilot.gcs.streams import put_mission_current
from cosim_models.autopilot.gcs.targets import is_place, locate
from cosim_models.autopilot.gcs.words import PLAN_RECEIVED, USE_INT, say

__all__ = [
    "COMMAND",
    "LATITUDE",
    "LONGITUDE",
    "P1",
    "P2",
    "P3",
    "append_waypoint",
    "continue_upload",
    "item_place",
    "mission_protocol",
    "set_current",
    "tell_reached",
]

COMMAND, FRAME, P1, P2, P3, _P4, LATITUDE, LONGITUDE, HEIGHT = range(9)  # columns of the table
_ASK_AGAIN, _GIVE_UP = 1.0, 8.0  # s
_ACK, _COUNT, _CURRENT = (cast(int, np.int64(i)) for i in (MISSION_ACK, MISSION_COUNT, MISSION_CURRENT))
_ITEM, _ITEM_INT, _REACHED, _REQUEST = (
    cast(int, np.int64(i)) for i in (MISSION_ITEM, MISSION_ITEM_INT, MISSION_ITEM_REACHED, MISSION_REQUEST)
)


@kernel
def _acknowledge(m: Any, result: int, kind: int, sender: int, part: int) -> None:
    encode_mission_ack(m.payload, sender, part, result, kind)
    send(m, _ACK)


@kernel
def tell_reached(m: Any, sequence: int) -> None:
    """Sends MISSION_ITEM_REACHED."""
    encode_mission_item_reached(m.payload, sequence)
    send(m, _REACHED)


@kernel
def item_place(m: Any, sequence: int) -> tuple[float, float, float]:
    """Returns the place of an item, NED."""
    r = m.mission[sequence]
    return locate(m, int(r[FRAME]), int(r[LATITUDE]), int(r[LONGITUDE]), float(r[HEIGHT]))


@kernel
def append_waypoint(m: Any) -> None:
    """Adds the present place, at its height above the sea, to the mission if there is room."""
    row = max(m.mission_count, 1)
    if row >= MAX_MISSION:
        return
    phi, psi, alt = geodetic_from_local(
        m.position[0], m.position[1], m.position[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    r = m.mission[row]
    for i in range(r.shape[0]):
        r[i] = 0.0
    r[COMMAND], r[FRAME], r[HEIGHT] = MAV_CMD_NAV_WAYPOINT, MAV_FRAME_GLOBAL, alt
    r[LATITUDE], r[LONGITUDE] = deg_e7(phi), deg_e7(psi)
    m.mission_count = row + 1


@kernel
def _ask_for_next(m: Any, t: float) -> None:
    encode_mission_request(m.payload, m.upload_system, m.upload_component, m.upload_next, 0)
    if send(m, _REQUEST):
        m.upload_asked = t


@kernel
def continue_upload(m: Any, t: float) -> None:
    """Repeats the request for the next item when due, or gives the upload up."""
    if t - m.upload_heard >= _GIVE_UP:
        m.uploading = False
        _acknowledge(m, MAV_MISSION_OPERATION_CANCELLED, 0, m.upload_system, m.upload_component)
    elif t - m.upload_asked >= _ASK_AGAIN - 1e-9 and can_answer(m):
        _ask_for_next(m, t)


@kernel
def _send_item(m: Any, sequence: int, whole: bool, sender: int, part: int) -> None:
    """Answers MISSION_REQUEST_INT (`whole`: the place in degE7) and MISSION_REQUEST."""
    if sequence >= max(m.mission_count, 1):
        if whole and m.kind != MAV_TYPE_QUADROTOR:
            encode_mission_count(m.payload, sender, part, m.mission_count, 0)
            send(m, _COUNT)
        _acknowledge(m, MAV_MISSION_INVALID_SEQUENCE, 0, sender, part)
        return
    r = m.mission[sequence]
    command, frame, lat, lon, z = int(r[COMMAND]), int(r[FRAME]), int(r[LATITUDE]), int(r[LONGITUDE]), float(r[HEIGHT])
    if sequence == 0:
        phi, psi, z = geodetic_from_local(
            m.home[0], m.home[1], m.home[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
        )
        command, frame, lat, lon = MAV_CMD_NAV_WAYPOINT, MAV_FRAME_GLOBAL, deg_e7(phi), deg_e7(psi)
    current = 1 if sequence == m.mission_current else 0
    p = float(r[P1]), float(r[P2]), float(r[P3]), float(r[_P4])
    if whole:
        encode_mission_item_int(
            m.payload, sender, part, sequence, frame, command, current, 1, p[0], p[1], p[2], p[3], lat, lon, z, 0
        )
        send(m, _ITEM_INT)
        return
    x, y = 1e-7 * lat, 1e-7 * lon
    encode_mission_item(
        m.payload, sender, part, sequence, frame, command, current, 1, p[0], p[1], p[2], p[3], x, y, z, 0
    )
    send(m, _ITEM)


@kernel
def _begin_upload(m: Any, count: int, kind: int, sender: int, part: int, t: float) -> None:
    if kind != MAV_MISSION_TYPE_MISSION or count > MAX_MISSION:
        refusal = MAV_MISSION_UNSUPPORTED if kind != MAV_MISSION_TYPE_MISSION else MAV_MISSION_NO_SPACE
        _acknowledge(m, refusal, kind, sender, part)
        return
    if m.uploading and not (sender == m.upload_system and part == m.upload_component):
        _acknowledge(m, MAV_MISSION_DENIED, kind, sender, part)
        return
    m.mission_count = 0
    m.mission_current = 0
    m.uploading = count > 0
    if count == 0:
        _acknowledge(m, MAV_MISSION_ACCEPTED, kind, sender, part)
        return
    m.upload_count, m.upload_next = count, 0
    m.upload_system, m.upload_component = sender, part
    m.upload_heard = t
    _ask_for_next(m, t)


@kernel
def _begin_partial_upload(m: Any, first: int, last: int, kind: int, sender: int, part: int, t: float) -> None:
    """Handles MISSION_WRITE_PARTIAL_LIST: items `first` to `last` of the mission replace the old ones."""
    if kind != MAV_MISSION_TYPE_MISSION:
        _acknowledge(m, MAV_MISSION_UNSUPPORTED, kind, sender, part)
    elif m.uploading and not (sender == m.upload_system and part == m.upload_component):
        _acknowledge(m, MAV_MISSION_DENIED, kind, sender, part)
    elif first < 0 or last < first or last > max(m.mission_count, 1) or last >= MAX_MISSION:
        _acknowledge(m, MAV_MISSION_ERROR, kind, sender, part)
    else:
        m.uploading = True
        m.upload_count, m.upload_next = last + 1, first
        m.upload_system, m.upload_component = sender, part
        m.upload_heard = t
        _ask_for_next(m, t)


@kernel
def set_current(m: Any, sequence: float) -> bool:
    """Makes an item of the mission the current one; returns whether there is one of this number."""
    if not 0.0 < sequence < m.mission_count:
        return False
    m.mission_current = int(sequence)
    m.item_since = -1.0
    m.item_told = 0
    return True


@kernel
def _tell_current(m: Any) -> None:
    put_mission_current(m)
    send(m, _CURRENT)


def _upload(flown: Sequence[int]) -> Callable[[Any, int, int, int, float], None]:
    """Returns a kernel of (record, message id, sender, its component, time [s]) for an uploaded item."""
    known = np.array(flown, dtype=np.int64)

    @kernel
    def check(command: int, frame: int, lat: int, lon: int, z: float, p: tuple[float, float, float, float]) -> int:
        for i in range(known.shape[0]):
            if known[i] == command:
                place = command >= MAV_CMD_NAV_LAST or is_place(frame, lat, lon, z)
                return MAV_MISSION_ACCEPTED if place and math.isfinite(p[0] + p[1] + p[2]) else MAV_MISSION_INVALID
        return MAV_MISSION_UNSUPPORTED

    @kernel
    def keep(m: Any, message: int, sender: int, part: int, t: float) -> None:
        if message == MISSION_ITEM_INT:
            r = decode_mission_item_int(m.received)
            sequence, frame, command, lat, lon, z = r[2], r[3], r[4], r[11], r[12], r[13]
            p = r[7], r[8], r[9], r[10]
        else:
            q = decode_mission_item(m.received)
            sequence, frame, command, lat, lon, z = q[2], q[3], q[4], int(q[11] * 1e7), int(q[12] * 1e7), q[13]
            p = q[7], q[8], q[9], q[10]
        if not m.uploading or sender != m.upload_system or part != m.upload_component:
            return
        m.upload_heard = t
        if sequence != m.upload_next:
            _acknowledge(m, MAV_MISSION_INVALID_SEQUENCE, 0, sender, part)
            return
        result = check(command, frame, lat, lon, z, p) if sequence > 0 else MAV_MISSION_ACCEPTED
        if result != MAV_MISSION_ACCEPTED:
            m.uploading = False
            _acknowledge(m, result, 0, sender, part)
            return
        row = m.mission[sequence]
        row[COMMAND], row[FRAME], row[LATITUDE], row[LONGITUDE], row[HEIGHT] = command, frame, lat, lon, z
        row[P1], row[P2], row[P3], row[_P4] = p[0], p[1], p[2], p[3]
        m.upload_next = sequence + 1
        if m.upload_next == m.upload_count:
            m.uploading = False
            m.mission_count = max(m.mission_count, m.upload_count)
            m.item_told = 0
            say(m, MAV_SEVERITY_INFO, PLAN_RECEIVED, 0)
            _acknowledge(m, MAV_MISSION_ACCEPTED, 0, sender, part)
        else:
            _ask_for_next(m, t)

    return keep


def mission_protocol(flown: Sequence[int]) -> Callable[[Any, int, int, int, float], bool]:
    """Returns a kernel of (record, message id, sender, its component, time [s]) that handles the mission protocol.

    The kernel returns whether the message belongs to the protocol.

    Args:
        flown: the MAV_CMDs that the autopilot carries out.
    """
    keep = _upload(flown)

    @kernel
    def hear(m: Any, message: int, sender: int, part: int, t: float) -> bool:
        known = MISSION_WRITE_PARTIAL_LIST <= message <= MISSION_REQUEST_INT or message == MISSION_ITEM_INT
        if not known:
            return False
        if not can_answer(m):
            return True
        if message in (MISSION_ITEM, MISSION_ITEM_INT):
            keep(m, message, sender, part, t)
        elif message == MISSION_COUNT:
            _, _, count, kind = decode_mission_count(m.received)
            _begin_upload(m, count, kind, sender, part, t)
        elif message == MISSION_WRITE_PARTIAL_LIST:
            _, _, first, last, kind = decode_mission_write_partial_list(m.received)
            _begin_partial_upload(m, first, last, kind, sender, part, t)
        elif message == MISSION_REQUEST_LIST:
            _, _, kind = decode_mission_request_list(m.received)
            if kind <= MAV_MISSION_TYPE_RALLY:  # of fences and rally points, there are none
                count = m.mission_count if kind == MAV_MISSION_TYPE_MISSION else 0
                encode_mission_count(m.payload, sender, part, count, kind)
                send(m, _COUNT)
            else:
                _acknowledge(m, MAV_MISSION_UNSUPPORTED, kind, sender, part)
        elif message in (MISSION_REQUEST_INT, MISSION_REQUEST):
            _, _, sequence, kind = decode_mission_request(m.received)
            if kind == MAV_MISSION_TYPE_MISSION:
                if message == MISSION_REQUEST:
                    say(m, MAV_SEVERITY_WARNING, USE_INT, 0)
                _send_item(m, sequence, message == MISSION_REQUEST_INT, sender, part)
            else:
                _acknowledge(m, MAV_MISSION_UNSUPPORTED, kind, sender, part)
        elif message == MISSION_CLEAR_ALL:
            _, _, kind = decode_mission_clear_all(m.received)
            if kind == MAV_MISSION_TYPE_MISSION:
                m.mission_count, m.mission_current, m.uploading = 0, 0, False
            result = MAV_MISSION_ACCEPTED if kind == MAV_MISSION_TYPE_MISSION else MAV_MISSION_UNSUPPORTED
            _acknowledge(m, result, kind, sender, part)
        elif message == MISSION_SET_CURRENT:
            _, _, sequence = decode_mission_set_current(m.received)
            if set_current(m, float(sequence)):
                _tell_current(m)
        return True

    return hear
