"""The questions of `benchmarks.wire`, and the answers that ArduCopter 4.7-dev gives with default parameters.

A question is asked in the air (GUIDED at 10 m) or on the ground (disarmed). The answers were recorded from a simulated
ArduCopter (git 90700977) over its JSON interface.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = ["QUESTIONS", "Question"]

OK, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
AIR, GROUND = "air", "ground"
NAN = math.nan
HERE = (-353632620, 1491652370)
"""Latitude and longitude [degE7] of the start."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question of a ground station, and ArduCopter's answer.

    Attributes:
        name: unique.
        state: AIR or GROUND.
        message: what is sent.
        result: of the COMMAND_ACK; None: there is none.
        texts: words of the STATUSTEXTs; None: they vary.
        reply: types of the messages that come besides; None: they vary.
    """

    name: str
    state: str
    message: Any
    result: int | None
    texts: tuple[str, ...] | None = ()
    reply: tuple[str, ...] | None = ()


def long(number: int, *p: float) -> Any:
    """A COMMAND_LONG."""
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *p, *[0.0] * (7 - len(p)))


def whole(number: int, *p: float, frame: int = 3, x: int = HERE[0], y: int = HERE[1], z: float = 10.0) -> Any:
    """A COMMAND_INT."""
    return mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *p, *[0.0] * (4 - len(p)), x, y, z)


def _messages() -> Iterator[Question]:
    """REQUEST_MESSAGE: what is sent, what is known but has nothing to say, what is not known."""
    sent = (0, 1, 2, 24, 26, 27, 29, 30, 31, 32, 33, 36, 42, 49, 62, 65, 74, 83, 105, 116, 125, 129, 136, 137, 147, 148)
    sent = (*sent, 152, 163, 164, 165, 168, 178, 193, 235, 241, 242, 245, 264, 286, 376)
    for number in sent:
        name = mavlink.mavlink_map[number].msgname
        yield Question(f"REQUEST_MESSAGE {number} {name}", AIR, long(512, number), OK, reply=(name,))
    silent = (
        22,
        35,
        100,
        124,
        127,
        128,
        132,
        143,
        162,
        173,
        180,
        191,
        192,
        194,
        225,
        226,
        246,
        259,
        260,
        262,
        269,
        271,
    )
    for number in (*silent, 280, 281, 285, 295, 301, 373):
        yield Question(f"REQUEST_MESSAGE {number}", AIR, long(512, number), OK)
    yield Question("REQUEST_MESSAGE 435", AIR, long(512, 435), OK, reply=("UNKNOWN_435",))  # AVAILABLE_MODES
    unknown = (4, 8, 11, 21, 23, 39, 43, 44, 45, 47, 50, 66, 69, 70, 75, 76, 77, 82, 84, 86, 107, 109, 110, 121, 126)
    for number in (*unknown, 131, 140, 149, 222, 253, 256, 370, 9999):
        yield Question(f"REQUEST_MESSAGE {number}", AIR, long(512, number), FAILED)


def _intervals() -> Iterator[Question]:
    for number in (30, 31, 33, 83, 105, 100, 132):
        yield Question(f"SET_MESSAGE_INTERVAL {number}", AIR, long(511, number, 1e6), OK)
    yield Question("SET_MESSAGE_INTERVAL default", AIR, long(511, 30, 0), OK)
    yield Question("SET_MESSAGE_INTERVAL off", AIR, long(511, 30, -1), OK)
    yield Question("SET_MESSAGE_INTERVAL negative", AIR, long(511, 30, -2), DENIED)
    words = "No ap_message for mavlink id (9999)"
    yield Question("SET_MESSAGE_INTERVAL unknown", AIR, long(511, 9999, 1e6), DENIED, (words,))
    yield Question("GET_MESSAGE_INTERVAL", AIR, long(510, 30), OK, reply=("MESSAGE_INTERVAL",))


def _modes() -> Iterator[Question]:
    init = "Mode change to {} failed: init failed"
    for number, result, words in (
        *((number, OK, ()) for number in (0, 1, 2, 4, 5, 6, 7, 9, 11, 16, 17, 19, 20, 21, 24)),
        (3, FAILED, (init.format("AUTO"),)),
        (8, FAILED, ("No such mode 8",)),
        (10, FAILED, ("No such mode 10",)),
        (12, FAILED, ("No such mode 12",)),
        (13, FAILED, ("No such mode 13",)),
        (14, FAILED, (init.format("FLIP"),)),
        (15, FAILED, (init.format("AUTOTUNE"),)),
        (18, FAILED, (init.format("THROW"),)),
        (22, FAILED, (init.format("FLOWHOLD"),)),
        (23, FAILED, ("Set FOLL_ENABLE = 1", init.format("FOLLOW"))),
        (25, FAILED, ("No axis selected, SID_AXIS = 0", init.format("SYSTEMID"))),
        (26, FAILED, ("No such mode 26",)),
        (
            27,
            FAILED,
            (
                "Unable to start landing sequence",
                "Mode change to AUTO RTL failed: No return path or ",
                "landing sequence found",
            ),
        ),
        (28, FAILED, (init.format("TURTLE"),)),
        (99, FAILED, ("No such mode 99",)),
    ):
        yield Question(f"DO_SET_MODE {number}", AIR, long(176, 1, number), result, words, None)
    yield Question("DO_SET_MODE without custom mode", AIR, long(176, 0, 4), DENIED)
    yield Question("AUTO without mission, ground", GROUND, long(176, 1, 3), OK, reply=None)


def _common_commands() -> Iterator[Question]:
    """Commands that ground stations send."""
    landing = ("Unable to start landing sequence", "Mode change to AUTO RTL failed: No landing sequenc", "e found")
    rows: tuple[tuple[str, str, Any, int, tuple[str, ...] | None], ...] = (
        ("GIMBAL_PITCHYAW", AIR, long(1000), FAILED, ()),
        ("GIMBAL_CONFIGURE", AIR, long(1001), FAILED, ()),
        ("SET_HOME here", AIR, whole(179, 1), OK, ()),
        ("SET_RELAY", AIR, long(181, 0, 1), OK, ()),
        ("SET_SERVO", AIR, long(183, 9, 1700), OK, ()),
        ("REPEAT_SERVO", AIR, long(184, 9, 1700, 2, 1), OK, ()),
        ("LAND_START", AIR, long(189), FAILED, landing),
        ("CONTINUE", AIR, long(193, 1), OK, ()),
        ("PAUSE", AIR, long(193, 0), OK, ()),
        ("ROI_LOCATION", AIR, whole(195), OK, ()),
        ("ROI_NONE", AIR, whole(197), OK, ()),
        ("IMAGE_START", AIR, long(2000), FAILED, ()),
        ("ROI", AIR, long(201, 0, 0, 0, 0, -35.36, 149.16, 5), OK, ()),
        ("DIGICAM_CONTROL", AIR, long(203), OK, ()),
        ("PARACHUTE enable", AIR, long(208, 1), OK, ()),
        ("AUX_FUNCTION", AIR, long(218, 9, 0), OK, ()),
        ("SET_CURRENT without mission", AIR, long(224, 0), FAILED, ()),
        ("STORAGE reset", GROUND, long(245, 2), OK, ("All parameters reset, reboot board",)),
        ("VIDEO_START", AIR, long(2500), FAILED, ()),
        ("HIGH_LATENCY off", AIR, long(2600, 0), OK, ("High Latency disabled",)),
        ("MISSION_START without mission", GROUND, long(300), OK, None),
        ("RUN_PREARM", GROUND, long(401), OK, None),
        ("FIXED_MAG_CAL_YAW", GROUND, long(42006), OK, ()),
        ("MAG_CAL start", GROUND, long(42424), OK, ()),
        ("MAG_CAL cancel", GROUND, long(42426), OK, ()),
        ("WINCH", AIR, long(42600), FAILED, ()),
        ("BATTERY_RESET", AIR, long(42651, 1, 100), OK, ()),
        ("EXTERNAL_WIND", AIR, long(43004, 5, 1, 90, 1), OK, ()),
        ("DO_JUMP_TAG", AIR, long(601, 7), FAILED, ()),
        ("REPOSITION", AIR, whole(192, -1, 0, 0, NAN), OK, ()),
        ("REPOSITION terrain", AIR, whole(192, -1, frame=10), OK, ()),
        ("REPOSITION unknown frame", AIR, whole(192, -1, frame=21), DENIED, ("Unknown mavlink coordinate frame 21",)),
        ("REPOSITION nowhere", AIR, whole(192, -1, x=0, y=0), DENIED, ()),
        ("REPOSITION as COMMAND_LONG", AIR, long(192), UNSUPPORTED, ()),
        ("TAKEOFF in the air", AIR, long(22, 0, 0, 0, 0, 0, 0, 20), FAILED, ()),
        ("TAKEOFF disarmed", GROUND, long(22, 0, 0, 0, 0, 0, 0, 10), FAILED, ()),
        ("TAKEOFF frame 0", AIR, whole(22, frame=0), DENIED, ()),
        ("TAKEOFF frame 10", AIR, whole(22, frame=10), DENIED, ()),
        ("ARM armed", AIR, long(400, 1), OK, ()),
        ("DISARM flying", AIR, long(400, 0), FAILED, ()),
        ("DISARM disarmed", GROUND, long(400, 0), OK, ()),
        ("CAPABILITIES", AIR, long(520, 1), OK, ()),
        ("HOME_POSITION", AIR, long(410), OK, ()),
        ("PROTOCOL_VERSION", AIR, long(519, 1), UNSUPPORTED, ()),
        ("CONDITION_YAW", AIR, long(115, 90, 20, 1), OK, ()),
        ("CHANGE_SPEED", AIR, long(178, 1, 5, -1), OK, ()),
        ("LAND", AIR, long(21), OK, None),
        ("RTL", AIR, long(20), OK, None),
        ("unknown", AIR, long(31010), UNSUPPORTED, ()),
    )
    replies = {"SET_HOME here": ("HOME_POSITION", "GPS_GLOBAL_ORIGIN"), "CAPABILITIES": ("AUTOPILOT_VERSION",)}
    replies["HOME_POSITION"] = replies["SET_HOME here"]
    varying = {"LAND", "RTL", "MISSION_START without mission", "REPOSITION", "REPOSITION terrain"}
    for name, state, message, result, texts in rows:
        reply = None if name in varying else replies.get(name, ())
        yield Question(name, state, message, result, texts, reply)
    yield Question("BANNER", AIR, long(42428), OK, None, ())


def _commands() -> Iterator[Question]:
    """Further commands, and forms that are refused."""
    flying = "Motor Test: vehicle not landed"
    in_use = "ServoRelayEvent: Channel 1 is already in use"
    rows: tuple[tuple[str, str, Any, int, tuple[str, ...] | None], ...] = (
        ("SET_HOME mode 2", AIR, whole(179, 2), FAILED, ()),
        ("SET_HOME unknown frame", AIR, whole(179, 0, frame=21), DENIED, ("Unknown mavlink coordinate frame 21",)),
        ("SET_HOME off the globe", AIR, whole(179, 0, x=910000000), FAILED, ()),
        ("SET_RELAY 5", AIR, long(181, 5, 1), FAILED, ()),
        ("REPEAT_RELAY", AIR, long(182, 0, 1, 1), OK, ()),
        ("REPEAT_RELAY 5", AIR, long(182, 5, 1, 1), FAILED, ()),
        ("SET_SERVO of a motor", AIR, long(183, 1, 1700), FAILED, (in_use,)),
        ("SET_SERVO 33", AIR, long(183, 33, 1700), FAILED, ()),
        ("FLIGHTTERMINATION 0", AIR, long(185, 0), FAILED, ()),
        ("PAUSE 2", AIR, long(193, 2), DENIED, ()),
        ("PAUSE on the ground", GROUND, long(193, 0), FAILED, ("Failed to pause",)),
        ("CONTINUE on the ground", GROUND, long(193, 1), FAILED, ("Failed to resume",)),
        ("ROI unknown frame", AIR, whole(195, frame=21), DENIED, ("Unknown mavlink coordinate frame 21",)),
        ("ROI off the globe", AIR, whole(195, x=910000000), FAILED, ()),
        ("ROI_SYSID", AIR, long(198, 2), OK, ()),
        ("DIGICAM_CONFIGURE", AIR, long(202), OK, ()),
        ("MOUNT_CONFIGURE", AIR, long(204), FAILED, ()),
        ("MOUNT_CONTROL", AIR, long(205), FAILED, ()),
        ("CAM_TRIGG_DIST", AIR, long(206, 5), OK, ()),
        ("FENCE_ENABLE", AIR, long(207, 1), OK, ()),
        ("FENCE_DISABLE", AIR, long(207, 0), OK, ()),
        ("PARACHUTE 3", AIR, long(208, 3), FAILED, ()),
        ("MOTOR_TEST flying", AIR, long(209, 1, 0, 10, 1), FAILED, (flying,)),
        ("MOTOR_TEST", GROUND, long(209, 1, 0, 5, 1), OK, ("starting motor test",)),
        ("GRIPPER", AIR, long(211, 1, 0), FAILED, ()),
        ("SPRAYER", AIR, long(216, 1), OK, ()),
        ("AUX_FUNCTION position 3", AIR, long(218, 9, 3), DENIED, ()),
        ("CALIBRATION flying", AIR, long(241, 1), FAILED, ("Disarm to allow calibration",)),
        ("CALIBRATION gyro", GROUND, long(241, 1), OK, None),
        ("CALIBRATION none", GROUND, long(241), UNSUPPORTED, ()),
        ("RUN_PREARM armed", AIR, long(401), REJECTED, ()),
        ("START_RX_PAIR", AIR, long(500), OK, ()),
        ("FOLLOW", AIR, long(32, 1), OK, ()),
        ("FOLLOW nobody", AIR, long(32, 0), DENIED, ()),
        ("EKF_SOURCE 1", AIR, long(42007, 1), OK, ()),
        ("EKF_SOURCE 4", AIR, long(42007, 4), DENIED, ()),
        ("MAG_CAL flying", AIR, long(42424), FAILED, ("Disarm to allow compass calibration",)),
        ("VIDEO_STOP", AIR, long(2501), FAILED, ()),
        ("HIGH_LATENCY on", AIR, long(2600, 1), OK, ("High Latency enabled",)),
        ("MISSION_START first item", GROUND, long(300, 1), DENIED, ()),
        ("WIND negative", AIR, long(43004, -1, 1, 90, 1), DENIED, ()),
        ("CHANGE_SPEED 0", AIR, long(178, 1, 0), DENIED, ()),
        ("CHANGE_SPEED kind 4", AIR, long(178, 4, 5), DENIED, ()),
        ("CONDITION_YAW 400", AIR, long(115, 400), FAILED, ()),
        ("CAPABILITIES 0", AIR, long(520, 0), FAILED, ()),
        ("LOITER_UNLIM", AIR, long(17), OK, None),
        ("SOLO_FLY_CLICK", AIR, long(42001), OK, None),
        ("SOLO_PAUSE_CLICK", AIR, long(42003), OK, None),
        ("VTOL_LAND", AIR, long(85), OK, None),
        ("ARM 2", GROUND, long(400, 2), UNSUPPORTED, ()),
        ("SET_REVERSE", AIR, long(194), UNSUPPORTED, ()),
        ("GO_AROUND", AIR, long(191), UNSUPPORTED, ()),
        ("AUTOTUNE_ENABLE", AIR, long(212, 1), UNSUPPORTED, ()),
        ("GUIDED_LIMITS", AIR, long(222), UNSUPPORTED, ()),
        ("CHANGE_ALTITUDE", AIR, long(186), UNSUPPORTED, ()),
        ("SET_ACTUATOR", AIR, long(187), UNSUPPORTED, ()),
        ("VTOL_TRANSITION", AIR, long(3000), UNSUPPORTED, ()),
        ("ORBIT", AIR, long(34), UNSUPPORTED, ()),
    )
    moves = {"LOITER_UNLIM", "SOLO_FLY_CLICK", "SOLO_PAUSE_CLICK", "VTOL_LAND", "CALIBRATION gyro", "MOTOR_TEST"}
    for name, state, message, result, texts in rows:
        yield Question(name, state, message, result, texts, None if name in moves else ())


def _protocols() -> Iterator[Question]:
    """Messages that are no commands."""
    m = mavlink
    fetch = "Received message (FENCE_FETCH_POINT) is deprecated", "Invalid fence point, index past total(0 >= 0)"
    rally = "Received message (RALLY_FETCH_POINT) is deprecated", "Failed to get rally point"
    deprecated = ("got MISSION_REQUEST; use MISSION_REQUEST_INT!",)
    for name, message, texts, reply in (
        ("FENCE_FETCH_POINT", m.MAVLink_fence_fetch_point_message(1, 1, 0), fetch, ()),
        ("RALLY_FETCH_POINT", m.MAVLink_rally_fetch_point_message(1, 1, 0), rally, ()),
        ("LOG_REQUEST_LIST", m.MAVLink_log_request_list_message(1, 1, 0, 9), ("Disarm for log download",), ()),
        ("LOG_REQUEST_DATA", m.MAVLink_log_request_data_message(1, 1, 1, 0, 90), None, ()),  # the text comes once
        (
            "MISSION_REQUEST_LIST to 190",
            m.MAVLink_mission_request_list_message(1, 190),
            (),
            ("MISSION_COUNT",),
        ),
        ("MISSION_REQUEST_LIST", m.MAVLink_mission_request_list_message(1, 1), (), ("MISSION_COUNT",)),
        ("MISSION_REQUEST_LIST fence", m.MAVLink_mission_request_list_message(1, 1, 1), (), ("MISSION_COUNT",)),
        ("MISSION_REQUEST_LIST rally", m.MAVLink_mission_request_list_message(1, 1, 2), (), ("MISSION_COUNT",)),
        ("MISSION_REQUEST_LIST other", m.MAVLink_mission_request_list_message(1, 1, 3), (), ("MISSION_ACK",)),
        ("MISSION_REQUEST_INT", m.MAVLink_mission_request_int_message(1, 1, 0), (), ("MISSION_ITEM_INT",)),
        ("MISSION_REQUEST", m.MAVLink_mission_request_message(1, 1, 0), deprecated, ("MISSION_ITEM",)),
        ("MISSION_REQUEST_INT 9", m.MAVLink_mission_request_int_message(1, 1, 9), (), ("MISSION_COUNT", "MISSION_ACK")),
        ("MISSION_CLEAR_ALL", m.MAVLink_mission_clear_all_message(1, 1), (), ("MISSION_ACK",)),
        ("MISSION_COUNT", m.MAVLink_mission_count_message(1, 1, 2), (), ("MISSION_REQUEST",)),
        ("MISSION_COUNT other", m.MAVLink_mission_count_message(1, 1, 2, 3), (), ("MISSION_ACK",)),
        ("WRITE_PARTIAL", m.MAVLink_mission_write_partial_list_message(1, 1, 0, 0), (), ("MISSION_REQUEST",)),
        (
            "PARAM_REQUEST_READ",
            m.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1),
            (),
            ("PARAM_VALUE",),
        ),
        ("PARAM_REQUEST_READ unknown", m.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1), (), ()),
        ("PARAM_SET", m.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 900.0, 9), (), ("PARAM_VALUE",)),
        ("PARAM_SET unknown", m.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, 9), (), ()),
        ("PARAM_REQUEST_LIST", m.MAVLink_param_request_list_message(1, 0), None, None),
        ("TERRAIN_CHECK", m.MAVLink_terrain_check_message(*HERE), (), ("TERRAIN_REPORT",)),
        ("TIMESYNC", m.MAVLink_timesync_message(0, 77), (), ("TIMESYNC",)),
        ("PING", m.MAVLink_ping_message(0, 1, 0, 0), (), ()),
        (
            "guided item",
            m.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, *HERE, 10),
            (),
            None,
        ),
        ("SET_MODE same", m.MAVLink_set_mode_message(1, 1, 4), (), ()),
    ):
        yield Question(name, AIR, message, None, texts, reply)
    logs = m.MAVLink_log_request_list_message(1, 1, 0, 9)
    yield Question("LOG_REQUEST_LIST on the ground", GROUND, logs, None, reply=("LOG_ENTRY",))
    yield Question("LOG_ERASE on the ground", GROUND, m.MAVLink_log_erase_message(1, 1), None)
    yield Question("LOG_REQUEST_END on the ground", GROUND, m.MAVLink_log_request_end_message(1, 1), None)
    # To another system: silence.
    other = mavlink.MAVLink_command_long_message(9, 1, 520, 0, 1, 0, 0, 0, 0, 0, 0)
    yield Question("another system", AIR, other, None)


QUESTIONS = (*_messages(), *_intervals(), *_modes(), *_common_commands(), *_commands(), *_protocols())
"""All questions, in the order in which they are asked."""
