"""ArduCopter's status texts (STATUSTEXT), queued and sent after the acknowledgements.

Kernels over the autopilot's record `m`.

Source: ArduPilot's texts, as recorded from ArduCopter 4.7-dev or read in its source.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import STATUSTEXT, encode_statustext, put_statustext_text
from cosim_models.autopilot.link.links import LINKS, send

__all__ = [
    "say_with",
    "POLYGON_BREACHED",
    "ARM_CHARGE",
    "ARM_VOLTAGE",
    "BATTERY_CRITICAL",
    "BATTERY_LOW",
    "BATTERY_LANDING",
    "BATTERY_DISARMING",
    "BATTERY_LOST",
    "ACCELS_INCONSISTENT",
    "AHRS_TYPE",
    "ARMING",
    "ARM_NEEDS_POSITION",
    "ARM_THROTTLE",
    "STABILIZE_REFUSED",
    "ATTITUDE_BAD",
    "AUTO_REFUSED",
    "BRAKE_REFUSED",
    "CIRCLE_BREACHED",
    "CIRCLE_REFUSED",
    "CRITICAL",
    "DISARMING",
    "GCS_AUTO",
    "GCS_CLEARED",
    "GCS_DISARMING",
    "GCS_LANDING",
    "GCS_LOST",
    "GCS_PILOT",
    "GUIDED_REFUSED",
    "HIGH_BREACHED",
    "INFO",
    "LOITER_REFUSED",
    "LOW_BREACHED",
    "MISSING_TAKEOFF",
    "MISSION_TEXTS",
    "NOT_ARMABLE",
    "NO_NUMBER",
    "NO_SUCH_MESSAGE",
    "NO_SUCH_MODE",
    "PLAN_RECEIVED",
    "PREARM_NEEDS_POSITION",
    "RADIO_AUTO",
    "RADIO_CLEARED",
    "RADIO_DISARMING",
    "RADIO_GUIDED",
    "RADIO_LANDING",
    "RADIO_LOST",
    "REACHED",
    "ROUND_BEGINS",
    "RTL_REFUSED",
    "WAITING_FOR_HOME",
    "WARNING",
    "say",
    "send_texts",
]

CRITICAL, WARNING, INFO = 2, 4, 6  # MAV_SEVERITY
_EVERY_LINK = 2**LINKS - 1
NO_NUMBER = -1
"""Number argument of `say` for texts without a number."""

_TEXTS: list[bytes] = []


def _text(text: bytes) -> int:
    _TEXTS.append(text)
    return len(_TEXTS) - 1


ARMING = _text(b"Arming motors")
DISARMING = _text(b"Disarming motors")
ACCELS_INCONSISTENT = _text(b"Arm: Accels inconsistent")
ATTITUDE_BAD = _text(b"Arm: EKF attitude is bad")
AHRS_TYPE = _text(b"Arm: AHRS: not using configured AHRS type")
WAITING_FOR_HOME = _text(b"Arm: AHRS: waiting for home")
ARM_NEEDS_POSITION = _text(b"Arm: Need Position Estimate")
PREARM_NEEDS_POSITION = _text(b"PreArm: Need Position Estimate")
GUIDED_REFUSED = _text(b"Mode change to GUIDED failed: requires position")
LOITER_REFUSED = _text(b"Mode change to LOITER failed: requires position")
RTL_REFUSED = _text(b"Mode change to RTL failed: requires position")
NO_SUCH_MODE = _text(b"No such mode %")
NO_SUCH_MESSAGE = _text(b"No ap_message for mavlink id (%)")
NOT_ARMABLE = _text(b"Arm: Mode not armable")
AUTO_REFUSED = _text(b"Mode change to AUTO failed: init failed")
MISSING_TAKEOFF = _text(b"Auto: Missing Takeoff Cmd")
PLAN_RECEIVED = _text(b"Flight plan received")
REACHED = _text(b"Reached command #%")
BRAKE_REFUSED = _text(b"Mode change to BRAKE failed: requires position")
GCS_LOST = _text(b"GCS Failsafe")
GCS_CLEARED = _text(b"GCS Failsafe Cleared")
HIGH_BREACHED = _text(b"Max Alt fence breached")
CIRCLE_BREACHED = _text(b"Circle fence breached")
LOW_BREACHED = _text(b"Min Alt fence breached")
BATTERY_LOST = _text(b"Battery Failsafe")
BATTERY_DISARMING = _text(b"Battery Failsafe - Disarming")
BATTERY_LANDING = _text(b"Battery Failsafe - Continuing Landing")
BATTERY_LOW = _text(b"Battery 1 is low $V used % mAh")
BATTERY_CRITICAL = _text(b"Battery 1 is critical $V used % mAh")
ARM_VOLTAGE = _text(b"Arm: Battery 1 below minimum arming voltage")
ARM_CHARGE = _text(b"Arm: Battery 1 below minimum arming capacity")
POLYGON_BREACHED = _text(b"Polygon fence breached")
CIRCLE_REFUSED = _text(b"Mode change to CIRCLE failed: requires position")
STABILIZE_REFUSED = _text(b"Mode change to STABILIZE failed: throttle too high")
ARM_THROTTLE = _text(b"Arm: Throttle too high")
RADIO_LOST = _text(b"Radio Failsafe")
RADIO_CLEARED = _text(b"Radio Failsafe Cleared")
RADIO_DISARMING = _text(b"Radio Failsafe - Disarming")
RADIO_LANDING = _text(b"Radio Failsafe - Continuing Landing")
RADIO_AUTO = _text(b"Radio Failsafe - Continuing Auto")
RADIO_GUIDED = _text(b"Radio Failsafe - Continuing Guided Mode")
GCS_DISARMING = _text(b"GCS Failsafe - Disarming")
GCS_LANDING = _text(b"GCS Failsafe - Continuing Landing")
GCS_AUTO = _text(b"GCS Failsafe - Continuing Auto Mode")
GCS_PILOT = _text(b"GCS Failsafe - Continuing Pilot Control")
# Texts of mission commands that begin, in the order of commands.
MISSION_TEXTS = _text(b"Mission: % WP")
_text(b"Mission: % LoitUnlim")
_text(b"Mission: % LoitTime")
_text(b"Mission: % RTL")
_text(b"Mission: % Land")
_text(b"Mission: % Takeoff")
_text(b"Mission: % Delay")
_text(b"Mission: % CondDelay")
_text(b"Mission: % CondYaw")
_text(b"Mission: % ChangeSpeed")
_text(b"Mission: % LoitTurns")
ROUND_BEGINS = _text(b"Mission: starting circle %/&")

_TEXT_BYTES = np.zeros((len(_TEXTS), 50), dtype=np.uint8)
for _i, _content in enumerate(_TEXTS):
    _TEXT_BYTES[_i, : len(_content)] = np.frombuffer(_content, dtype=np.uint8)
_TEXT_LENGTHS = np.array([len(text) for text in _TEXTS], dtype=np.int64)

_PLACE, _PLACE_OF_HUNDREDTHS, _PLACE_OF_SECOND, _POINT = 37, 36, 38, 46  # % $ & .


@kernel
def say(m: Any, severity: int, text: int, number: int) -> None:
    """Queues a STATUSTEXT, with `number` substituted for its "%". A full queue drops it."""
    say_with(m, severity, text, number, 0)


@kernel
def say_with(m: Any, severity: int, text: int, number: int, second: int) -> None:
    """Like `say`, with a second value substituted for "&" (integer) or "$" (two decimals)."""
    n = m.text_count
    if n < m.text_queue.shape[0]:
        m.text_queue[n, 0] = severity
        m.text_queue[n, 1] = text
        m.text_queue[n, 2] = number
        m.text_queue[n, 3] = second
        m.text_queue[n, 4] = _EVERY_LINK
        m.text_count = n + 1


@kernel
def send_texts(m: Any) -> None:
    """Sends the queued texts after the acknowledgements, as ArduCopter does; texts that do not fit wait."""
    for link in range(LINKS):
        m.link = link
        for row in range(m.text_count):
            waiting = m.text_queue[row, 4]
            if (waiting >> link) & 1 != 0:
                if not _send_text(m, row):
                    break
                m.text_queue[row, 4] = waiting - (1 << link)
    sent = 0
    while sent < m.text_count and m.text_queue[sent, 4] == 0:
        sent += 1
    if sent > 0:
        for i in range(sent, m.text_count):
            for k in range(5):
                m.text_queue[i - sent, k] = m.text_queue[i, k]
        m.text_count -= sent


@kernel
def _put_number(m: Any, at: int, number: int, least: int) -> int:
    """Writes a number with at least `least` digits at `at`; returns the number of characters."""
    digits = 1
    rest = number
    while rest >= 10:
        rest //= 10
        digits += 1
    digits = max(digits, least)
    rest = number
    for k in range(digits):
        put_statustext_text(m.payload, at + digits - 1 - k, 48 + rest % 10)
        rest //= 10
    return digits


@kernel
def _send_text(m: Any, row: int) -> bool:
    """Sends the text of a row of the queue, with its numbers."""
    text = m.text_queue[row, 1]
    encode_statustext(m.payload, m.text_queue[row, 0], 0, 0)
    at = 0
    for i in range(_TEXT_LENGTHS[text]):
        byte = _TEXT_BYTES[text, i]
        if byte == _PLACE:
            at += _put_number(m, at, m.text_queue[row, 2], 1)
        elif byte == _PLACE_OF_SECOND:
            at += _put_number(m, at, m.text_queue[row, 3], 1)
        elif byte == _PLACE_OF_HUNDREDTHS:
            at += _put_number(m, at, m.text_queue[row, 3] // 100, 1)
            put_statustext_text(m.payload, at, _POINT)
            at += 1 + _put_number(m, at + 1, m.text_queue[row, 3] % 100, 2)
        else:
            put_statustext_text(m.payload, at, byte)
            at += 1
    return send(m, STATUSTEXT)
