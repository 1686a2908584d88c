"""MAVLink's mission protocol, and the stored list of mission items.

A ground station uploads items, downloads them, clears them and sets the current one. During an upload, the autopilot
requests items one by one, repeats a request every second, and gives up after eight seconds. Item 0 is home. Commands
that this autopilot cannot fly are rejected during the upload. Fences and rally points have their own items (`fences`,
`rally`). While one system uploads, others are denied. Kernels over the autopilot's record `m`; `auto` flies the items,
`commands` handles guided targets.

Sources: the MAVLink guide, "Mission Protocol"; ArduPilot, MissionItemProtocol and AP_Mission.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.frames import deg_e7, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_CONDITION_DELAY,
    MAV_CMD_CONDITION_DISTANCE,
    MAV_CMD_CONDITION_YAW,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_DIGICAM_CONFIGURE,
    MAV_CMD_DO_DIGICAM_CONTROL,
    MAV_CMD_DO_FENCE_ENABLE,
    MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    MAV_CMD_DO_GRIPPER,
    MAV_CMD_DO_GUIDED_LIMITS,
    MAV_CMD_DO_JUMP,
    MAV_CMD_DO_JUMP_TAG,
    MAV_CMD_DO_LAND_START,
    MAV_CMD_DO_MOUNT_CONTROL,
    MAV_CMD_DO_PARACHUTE,
    MAV_CMD_DO_REPEAT_RELAY,
    MAV_CMD_DO_REPEAT_SERVO,
    MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    MAV_CMD_DO_SET_HOME,
    MAV_CMD_DO_SET_RELAY,
    MAV_CMD_DO_SET_ROI,
    MAV_CMD_DO_SET_ROI_LOCATION,
    MAV_CMD_DO_SET_ROI_NONE,
    MAV_CMD_DO_SET_SERVO,
    MAV_CMD_DO_SPRAYER,
    MAV_CMD_DO_WINCH,
    MAV_CMD_IMAGE_START_CAPTURE,
    MAV_CMD_IMAGE_STOP_CAPTURE,
    MAV_CMD_JUMP_TAG,
    MAV_CMD_NAV_DELAY,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LOITER_TIME,
    MAV_CMD_NAV_LOITER_TO_ALT,
    MAV_CMD_NAV_LOITER_TURNS,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RALLY_POINT,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_SPLINE_WAYPOINT,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_CMD_VIDEO_START_CAPTURE,
    MAV_CMD_VIDEO_STOP_CAPTURE,
    MAV_FRAME_GLOBAL,
    MAV_MISSION_ACCEPTED,
    MAV_MISSION_DENIED,
    MAV_MISSION_ERROR,
    MAV_MISSION_INVALID_PARAM1,
    MAV_MISSION_INVALID_PARAM5_X,
    MAV_MISSION_INVALID_PARAM6_Y,
    MAV_MISSION_INVALID_PARAM7,
    MAV_MISSION_INVALID_SEQUENCE,
    MAV_MISSION_NO_SPACE,
    MAV_MISSION_OPERATION_CANCELLED,
    MAV_MISSION_UNSUPPORTED,
    MAV_MISSION_UNSUPPORTED_FRAME,
    MISSION_ACK,
    MISSION_COUNT,
    MISSION_CURRENT,
    MISSION_ITEM,
    MISSION_ITEM_INT,
    MISSION_ITEM_REACHED,
    MISSION_REQUEST,
    encode_mission_ack,
    encode_mission_count,
    encode_mission_current,
    encode_mission_item,
    encode_mission_item_int,
    encode_mission_item_reached,
    encode_mission_request,
)
from cosim_models.autopilot.link.links import can_answer, send, send_to_all
from cosim_models.autopilot.mission.fences import (
    FENCE_CAPACITY,
    check_fence_item,
    fence_is_whole,
    keep_fence_item,
    place_fence,
    send_fence_item,
)
from cosim_models.autopilot.mission.rally import (
    RALLY_CAPACITY,
    RALLY_FRAME,
    RALLY_PLACE,
    check_rally_item,
    keep_rally_item,
)

__all__ = [
    "AUTOCONTINUE",
    "COMMAND",
    "DONE",
    "FENCE",
    "FRAME",
    "ITEM",
    "LATITUDE",
    "MISSION_CAPACITY",
    "P1",
    "P2",
    "P3",
    "P4",
    "RALLY",
    "Z",
    "ack_mission",
    "begin_partial_upload",
    "begin_upload",
    "clear_mission",
    "continue_upload",
    "forget_jumps",
    "is_uploading",
    "mission_count",
    "receive_item",
    "send_count",
    "send_item",
    "send_mission_current",
    "send_reached",
    "set_current",
]

MISSION_CAPACITY = 650
FENCE, RALLY = 1, 2  # MAV_MISSION_TYPE; 0 is a mission
COMMAND, FRAME, P1, P2, P3, P4, LATITUDE, LONGITUDE, Z, AUTOCONTINUE, DONE = range(11)
ITEM = 11
"""Columns of the table of items: as uploaded, positions in 1e-7 degrees; DONE counts the jumps taken."""

_ASK_AGAIN, _GIVE_UP = 1.0, 8.0  # s
_HIGHEST = 83000.0  # m
_AUTO = 3  # mode (`record.modes`, which is above this package)

_FLOWN = np.array(
    (
        MAV_CMD_NAV_WAYPOINT,
        MAV_CMD_NAV_LOITER_UNLIM,
        MAV_CMD_NAV_LOITER_TURNS,
        MAV_CMD_NAV_LOITER_TIME,
        MAV_CMD_NAV_RETURN_TO_LAUNCH,
        MAV_CMD_NAV_LAND,
        MAV_CMD_NAV_TAKEOFF,
        MAV_CMD_NAV_DELAY,
        MAV_CMD_CONDITION_DELAY,
        MAV_CMD_CONDITION_YAW,
        MAV_CMD_DO_JUMP,
        MAV_CMD_DO_CHANGE_SPEED,
        MAV_CMD_DO_JUMP_TAG,
        MAV_CMD_CONDITION_DISTANCE,
        MAV_CMD_DO_SET_HOME,
        MAV_CMD_DO_SET_RELAY,
        MAV_CMD_DO_REPEAT_RELAY,
        MAV_CMD_DO_SET_SERVO,
        MAV_CMD_DO_REPEAT_SERVO,
        MAV_CMD_DO_LAND_START,
        MAV_CMD_DO_SET_ROI_LOCATION,
        MAV_CMD_DO_SET_ROI_NONE,
        MAV_CMD_DO_SET_ROI,
        MAV_CMD_DO_DIGICAM_CONFIGURE,
        MAV_CMD_DO_DIGICAM_CONTROL,
        MAV_CMD_DO_MOUNT_CONTROL,
        MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        MAV_CMD_DO_FENCE_ENABLE,
        MAV_CMD_DO_PARACHUTE,
        MAV_CMD_DO_GRIPPER,
        MAV_CMD_DO_SPRAYER,
        MAV_CMD_DO_GUIDED_LIMITS,
        MAV_CMD_JUMP_TAG,
        MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        MAV_CMD_IMAGE_START_CAPTURE,
        MAV_CMD_IMAGE_STOP_CAPTURE,
        MAV_CMD_VIDEO_START_CAPTURE,
        MAV_CMD_VIDEO_STOP_CAPTURE,
        MAV_CMD_DO_WINCH,
        MAV_CMD_NAV_LOITER_TO_ALT,
        MAV_CMD_NAV_SPLINE_WAYPOINT,
    ),
    dtype=np.int64,
)


# ---- answers -------------------------------------------------------------------------------------------------------


@kernel
def ack_mission(m: Any, result: int, kind: int, system: int, component: int) -> None:
    """Sends MISSION_ACK to the ground station."""
    encode_mission_ack(m.payload, system, component, result, kind)
    send(m, MISSION_ACK)


@kernel
def mission_count(m: Any) -> int:
    """Returns the number of items, including home."""
    return int(max(m.mission_count, 1))


@kernel
def send_count(m: Any, kind: int, system: int, component: int) -> None:
    """Answers MISSION_REQUEST_LIST."""
    if kind > RALLY or (m.uploading and kind == m.upload_kind):
        ack_mission(m, MAV_MISSION_UNSUPPORTED if kind > RALLY else MAV_MISSION_DENIED, kind, system, component)
        return
    count = m.fence_count if kind == FENCE else m.rally_count if kind == RALLY else m.mission_count
    encode_mission_count(m.payload, system, component, count, kind)
    send(m, MISSION_COUNT)


@kernel
def send_item(m: Any, sequence: int, kind: int, system: int, component: int, whole: bool) -> None:
    """Answers MISSION_REQUEST_INT if `whole` (integer degrees), otherwise MISSION_REQUEST."""
    if whole and m.uploading and kind == m.upload_kind:
        ack_mission(m, MAV_MISSION_DENIED, kind, system, component)
        return
    if kind == FENCE and sequence < m.fence_count:
        send_fence_item(m, sequence, system, component, whole)
        return
    if kind == RALLY and sequence < m.rally_count:
        _send_rally_item(m, sequence, system, component, whole)
        return
    if kind != 0 or sequence >= mission_count(m):
        if whole and kind <= RALLY:
            send_count(m, kind, system, component)
        ack_mission(
            m, MAV_MISSION_UNSUPPORTED if kind > RALLY else MAV_MISSION_INVALID_SEQUENCE, kind, system, component
        )
        return
    r = m.mission[sequence]
    command, frame, carry_on = int(r[COMMAND]), int(r[FRAME]), int(r[AUTOCONTINUE])
    lat, lon, z = int(r[LATITUDE]), int(r[LONGITUDE]), float(r[Z])
    if sequence == 0:
        phi, psi, z = geodetic_from_local(
            m.home_neu[0], m.home_neu[1], -m.home_neu[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
        )
        command, frame, carry_on, lat, lon = MAV_CMD_NAV_WAYPOINT, MAV_FRAME_GLOBAL, 1, deg_e7(phi), deg_e7(psi)
    current = 1 if sequence == m.mission_current else 0
    p, place = (r[P1], r[P2], r[P3], r[P4]), (lat, lon, z)
    _send_item(m, system, component, sequence, frame, command, current, carry_on, p, place, 0, whole)


@kernel
def _send_rally_item(m: Any, sequence: int, system: int, component: int, whole: bool) -> None:
    r = m.rally[sequence]
    frame, place = int(r[RALLY_FRAME]), (int(r[RALLY_PLACE]), int(r[RALLY_PLACE + 1]), float(r[RALLY_PLACE + 2]))
    none = (0.0, 0.0, 0.0, 0.0)
    _send_item(m, system, component, sequence, frame, MAV_CMD_NAV_RALLY_POINT, 0, 0, none, place, RALLY, whole)


@kernel
def _send_item(
    m: Any,
    system: int,
    component: int,
    sequence: int,
    frame: int,
    command: int,
    current: int,
    carry_on: int,
    p: tuple[float, float, float, float],
    place: tuple[int, int, float],
    kind: int,
    whole: bool,
) -> None:
    """Sends MISSION_ITEM_INT if `whole` (integer degrees), otherwise MISSION_ITEM."""
    lat, lon, z = place
    if whole:
        encode_mission_item_int(
            m.payload,
            system,
            component,
            sequence,
            frame,
            command,
            current,
            carry_on,
            p[0],
            p[1],
            p[2],
            p[3],
            lat,
            lon,
            z,
            kind,
        )
        send(m, MISSION_ITEM_INT)
    else:
        encode_mission_item(
            m.payload,
            system,
            component,
            sequence,
            frame,
            command,
            current,
            carry_on,
            p[0],
            p[1],
            p[2],
            p[3],
            lat * 1e-7,
            lon * 1e-7,
            z,
            kind,
        )
        send(m, MISSION_ITEM)


@kernel
def send_mission_current(m: Any) -> bool:
    """Sends MISSION_CURRENT: the current item and the mission state."""
    total = mission_count(m) - 1
    active = 4 if m.paused else 3
    state = 1 if total == 0 else 5 if m.mission_complete else active if m.mode == _AUTO else 2
    encode_mission_current(m.payload, m.mission_current, total, state, 1 if m.mode == _AUTO else 0)
    return send(m, MISSION_CURRENT)


@kernel
def send_reached(m: Any, sequence: int) -> None:
    """Sends MISSION_ITEM_REACHED on all links."""
    encode_mission_item_reached(m.payload, sequence)
    send_to_all(m, MISSION_ITEM_REACHED)


# ---- uploads -------------------------------------------------------------------------------------------------------


@kernel
def clear_mission(m: Any, kind: int, system: int, component: int) -> None:
    """Handles MISSION_CLEAR_ALL for one type; like ArduCopter, it does not support "all types" (255).

    A mission that is being flown is kept.
    """
    if kind > RALLY:
        ack_mission(m, MAV_MISSION_UNSUPPORTED, kind, system, component)
        return
    if m.uploading and not is_uploading(m, system, component):
        ack_mission(m, MAV_MISSION_DENIED, kind, system, component)
        return
    if kind == 0 and m.armed and m.mode == _AUTO and not m.mission_complete:
        ack_mission(m, MAV_MISSION_ERROR, kind, system, component)
        return
    if kind == 0:
        m.mission_count = 0
        m.mission_current = 0
    if kind == FENCE:
        m.fence_count = 0
    if kind == RALLY:
        m.rally_count = 0
    m.uploading = False
    ack_mission(m, MAV_MISSION_ACCEPTED, kind, system, component)


@kernel
def is_uploading(m: Any, system: int, component: int) -> bool:
    """Returns whether an upload by this system and component is in progress."""
    return bool(m.uploading and system == m.upload_system and component == m.upload_component)


@kernel
def begin_upload(m: Any, count: int, kind: int, system: int, component: int, t: float) -> None:
    """Handles MISSION_COUNT: discards the items of this type and requests the first one."""
    if kind > RALLY:
        ack_mission(m, MAV_MISSION_UNSUPPORTED, kind, system, component)
        return
    if m.uploading and not is_uploading(m, system, component):
        ack_mission(m, MAV_MISSION_DENIED, kind, system, component)
        return
    if count > (FENCE_CAPACITY if kind == FENCE else RALLY_CAPACITY if kind == RALLY else MISSION_CAPACITY):
        ack_mission(m, MAV_MISSION_NO_SPACE, kind, system, component)
        return
    if kind == FENCE:
        m.fence_count = 0
    elif kind == RALLY:
        m.rally_count = 0
    else:
        m.mission_count = 0
        if m.mode != _AUTO or m.on_ground:  # in flight, the mission goes on at the same item
            m.mission_current = 0
            m.mission_complete = False
    m.uploading = count > 0
    m.transferring = True
    if count == 0:
        ack_mission(m, MAV_MISSION_ACCEPTED, kind, system, component)
        return
    _expect(m, 0, count, kind, system, component, t)


@kernel
def _expect(m: Any, first: int, count: int, kind: int, system: int, component: int, t: float) -> None:
    """Begins to request the items from `first` to `count` - 1."""
    m.uploading = True
    m.transferring = True
    m.upload_link = m.link
    m.upload_kind = kind
    m.upload_count = count
    m.upload_next = first
    m.upload_system = system
    m.upload_component = component
    m.upload_heard = t
    m.upload_asked = t - _ASK_AGAIN


@kernel
def begin_partial_upload(m: Any, first: int, last: int, kind: int, system: int, component: int, t: float) -> bool:
    """Handles MISSION_WRITE_PARTIAL_LIST: items `first` to `last` of the mission replace the old ones.

    Returns False if the mission has no such items.
    """
    if kind != 0:
        ack_mission(m, MAV_MISSION_UNSUPPORTED, kind, system, component)
    elif m.uploading and not is_uploading(m, system, component):
        ack_mission(m, MAV_MISSION_DENIED, kind, system, component)
    elif first < 0 or last < first or last > mission_count(m) or last >= MISSION_CAPACITY:
        ack_mission(m, MAV_MISSION_ERROR, kind, system, component)
        return False
    else:
        _expect(m, first, last + 1, kind, system, component, t)
    return True


@kernel
def continue_upload(m: Any, t: float) -> None:
    """Repeats the request for the next item when due, or gives the upload up."""
    if t - m.upload_heard >= _GIVE_UP:
        m.uploading = False
        ack_mission(m, MAV_MISSION_OPERATION_CANCELLED, m.upload_kind, m.upload_system, m.upload_component)
    elif t - m.upload_asked >= _ASK_AGAIN - 1e-9 and can_answer(m):
        encode_mission_request(m.payload, m.upload_system, m.upload_component, m.upload_next, m.upload_kind)
        if send(m, MISSION_REQUEST):
            m.upload_asked = t


@kernel
def _is_place(command: int) -> bool:
    """Returns whether latitude, longitude and height of a command are those of a place."""
    beside = command in (MAV_CMD_DO_SET_HOME, MAV_CMD_DO_SET_ROI, MAV_CMD_DO_SET_ROI_LOCATION, MAV_CMD_DO_LAND_START)
    return beside or (command < 90 and command != MAV_CMD_NAV_RETURN_TO_LAUNCH)


@kernel
def _check_item(command: int, frame: int, values: Any, latitude: float, longitude: float, z: float) -> int:
    """Returns the MAV_MISSION_RESULT for an item."""
    known = False
    for i in range(_FLOWN.shape[0]):
        known = known or command == _FLOWN[i]
    if not known:
        return MAV_MISSION_UNSUPPORTED
    if _is_place(command) and frame not in (0, 2, 3, 5, 6, 10, 11):
        return MAV_MISSION_UNSUPPORTED_FRAME
    if command != MAV_CMD_NAV_LAND:
        heading = command in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_TAKEOFF)  # their param 4 may be missing
        for i in range(3 if heading else 4):
            if not math.isfinite(values[i]):
                return MAV_MISSION_INVALID_PARAM1 + i
    if _is_place(command) and not abs(z) < _HIGHEST:
        return MAV_MISSION_INVALID_PARAM7
    if _is_place(command) and not abs(latitude) <= 9e8:
        return MAV_MISSION_INVALID_PARAM5_X
    if _is_place(command) and not abs(longitude) <= 1.8e9:
        return MAV_MISSION_INVALID_PARAM6_Y
    return MAV_MISSION_ACCEPTED


@kernel
def receive_item(
    m: Any,
    sequence: int,
    frame: int,
    command: int,
    carry_on: int,
    values: tuple[float, float, float, float],
    latitude: float,
    longitude: float,
    z: float,
    t: float,
) -> None:
    """Stores the next item of an upload (latitude and longitude in 1e-7 degrees); acknowledges the last one."""
    if not m.uploading:
        return
    kind = m.upload_kind
    m.upload_heard = t
    if sequence != m.upload_next:
        ack_mission(m, MAV_MISSION_INVALID_SEQUENCE, kind, m.upload_system, m.upload_component)
        return
    result = MAV_MISSION_ACCEPTED
    if kind == FENCE:
        result = check_fence_item(command, frame, values[0], latitude, longitude)
    elif kind == RALLY:
        result = check_rally_item(command, frame, latitude, longitude, z)
    elif sequence > 0:
        result = _check_item(command, frame, values, latitude, longitude, z)
    if result != MAV_MISSION_ACCEPTED:
        m.uploading = False
        ack_mission(m, result, kind, m.upload_system, m.upload_component)
        return
    if kind == FENCE:
        keep_fence_item(m, sequence, command, values[0], latitude, longitude)
    elif kind == RALLY:
        keep_rally_item(m, sequence, frame, latitude, longitude, z)
    else:
        _keep_item(m, sequence, frame, command, carry_on, values, latitude, longitude, z)
    m.upload_next = sequence + 1
    m.upload_asked = t - _ASK_AGAIN
    if m.upload_next == m.upload_count:
        _finish_upload(m)


@kernel
def _finish_upload(m: Any) -> None:
    """Completes an upload after its last item."""
    m.uploading = False
    result = MAV_MISSION_ACCEPTED
    if m.upload_kind == 0:
        m.mission_count = max(mission_count(m), m.upload_count)
        m.mission_replaced = True
    elif m.upload_kind == RALLY:
        m.rally_count = m.upload_count
    elif fence_is_whole(m, m.upload_count):
        place_fence(m, m.upload_count)
    else:
        result = MAV_MISSION_ERROR
    ack_mission(m, result, m.upload_kind, m.upload_system, m.upload_component)


@kernel
def _keep_item(
    m: Any,
    sequence: int,
    frame: int,
    command: int,
    carry_on: int,
    values: tuple[float, float, float, float],
    latitude: float,
    longitude: float,
    z: float,
) -> None:
    r = m.mission[sequence]
    r[COMMAND], r[FRAME], r[AUTOCONTINUE], r[DONE] = float(command), float(frame), float(carry_on), 0.0
    for i in range(4):
        r[P1 + i] = values[i] if math.isfinite(values[i]) else 0.0
    r[LATITUDE], r[LONGITUDE], r[Z] = latitude, longitude, z if math.isfinite(z) else 0.0


@kernel
def forget_jumps(m: Any) -> None:
    """Resets the counters of jumps taken."""
    for row in range(mission_count(m)):
        m.mission[row, DONE] = 0.0


@kernel
def set_current(m: Any, sequence: int) -> bool:
    """Sets the current item; returns False if there is no item with that number."""
    if not 0 <= sequence < mission_count(m):
        return False
    if sequence == 0 or m.mission_complete:
        forget_jumps(m)
    m.mission_current = sequence
    m.mission_changed = True
    m.mission_complete = False
    return True
