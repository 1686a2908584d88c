"""The battery of rovers, boats, planes and quadplanes: its model, its alarms, and the checks of arming.

The model is that of ArduPilot's simulation: 50 A at full throttle, which lower SIM_BATT_VOLTAGE by 0.7 V. It is drained
and checked ten times a second; an alarm that is there for the first time acts by BATT_FS_LOW_ACT or BATT_FS_CRT_ACT.
With BATT_MONITOR 0, nothing measures it. Kernels over a record that has `battery_parameters` and `BATTERY_MEMORY`
beside the variables of `gcs.record`.

Differences from ArduPilot: one battery, which is never empty (SIM_BATT_CAP_AH), no voltage at rest (BATT_FS_VOLTSRC);
BATT_MONITOR counts at once, and each of its values but 0 is 4.

Source: ArduPilot, AP_BattMonitor (check_failsafes, arming_checks), SITL (the model).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim import Memory, Variable
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_CRITICAL, MAV_SEVERITY_WARNING
from cosim_models.autopilot.commander.battery import CRITICAL_CHARGE, LOW_CHARGE, is_below
from cosim_models.autopilot.gcs.record import real, whole
from cosim_models.autopilot.gcs.words import ARM_BATTERY, BATTERY_ALARM, say, say_figures

__all__ = ["BATTERY_MEMORY", "alarming", "battery_parameters", "battery_permits_arming", "drain", "reset_battery"]

_FULL_CURRENT, _FULL_DROP = 50.0, 0.7  # A and V at full throttle
_MILLIAMPERE_HOUR = 3.6  # A s
_NO_ACTION = 0
_LEAST_URGENT = 127

BATTERY_MEMORY = (
    Memory("battery_since", shape=2, rare=True),  # s: since when the voltage is low, and critical; -1: it is not
    Memory("battery_at", rare=True),  # s, of the last look
    Memory("battery_urgency", dtype="i4", rare=True),  # of the action of the last alarm
)


def battery_parameters(actions: str) -> tuple[Variable, ...]:
    """Returns the parameters of the battery; `actions` describes those of its alarms."""
    return (
        whole("BATT_MONITOR", 4, "4: voltage and current are measured; 0: nothing is"),
        real("BATT_CAPACITY", "mAh", 3300.0, "capacity of the battery"),
        real("BATT_LOW_VOLT", "V", 10.5, "low voltage, 0: none"),
        real("BATT_LOW_MAH", "mAh", 0.0, "low remaining charge, 0: none"),
        real("BATT_CRT_VOLT", "V", 0.0, "critical voltage, 0: none"),
        real("BATT_CRT_MAH", "mAh", 0.0, "critical remaining charge, 0: none"),
        real("BATT_LOW_TIMER", "s", 10.0, "duration of low voltage until the alarm, 0: ignore voltages"),
        whole("BATT_FS_LOW_ACT", 0, f"battery low: {actions}"),
        whole("BATT_FS_CRT_ACT", 0, f"battery critical: {actions}"),
        real("BATT_ARM_VOLT", "V", 0.0, "voltage below which arming is refused, 0: none"),
        real("BATT_ARM_MAH", "mAh", 0.0, "remaining charge below which arming is refused, 0: none"),
        real("SIM_BATT_VOLTAGE", "V", 12.6, "voltage of the simulated battery without a load"),
    )


@kernel
def drain(m: Any, load: float, t: float) -> None:
    """Updates m.battery_voltage [V], _current [A], _used [mAh] and _left [%] for a load, 0 to 1, since the last one."""
    since = m.battery_at
    m.battery_at = t
    if m.BATT_MONITOR == 0:
        m.battery_voltage, m.battery_alarm = 0.0, 0
        return
    m.battery_current = _FULL_CURRENT * load
    m.battery_voltage = max(m.SIM_BATT_VOLTAGE - _FULL_DROP * load, 0.0)
    m.battery_used += m.battery_current * (t - since) / _MILLIAMPERE_HOUR
    left = 1.0 - m.battery_used / m.BATT_CAPACITY if m.BATT_CAPACITY > 0.0 else 0.0
    m.battery_left = 100.0 * min(max(left, 0.0), 1.0)


@kernel
def _charge_below(m: Any, least: float) -> bool:
    return bool(least > 0.0 and m.BATT_CAPACITY - m.battery_used < least)


@kernel
def _alarm(m: Any, t: float) -> int:
    """Returns the alarm of voltage and charge, 0: none."""
    low = is_below(m, 0, m.battery_voltage, m.BATT_LOW_VOLT, t)
    critical = is_below(m, 1, m.battery_voltage, m.BATT_CRT_VOLT, t)
    if critical or _charge_below(m, m.BATT_CRT_MAH):
        return CRITICAL_CHARGE
    return LOW_CHARGE if low or _charge_below(m, m.BATT_LOW_MAH) else 0


def alarming(urgency: Sequence[int]) -> Callable[[Any, float], int]:
    """Returns a kernel of (record, time [s]) that tells of an alarm that has just been raised.

    It returns the action that the alarm asks for, 0: none. Of a second alarm, an action that is less urgent than that
    of the first does not act.

    Args:
        urgency: actions, the most urgent first; all others are after them.
    """
    order = np.array(urgency, np.int64)

    @kernel
    def place_of(action: int) -> int:
        for i in range(order.size):
            if order[i] == action:
                return i
        return int(order.size)

    @kernel
    def new_action(m: Any, t: float) -> int:
        if not m.armed or m.BATT_MONITOR == 0:
            return _NO_ACTION
        alarm = _alarm(m, t)
        if alarm <= m.battery_alarm:
            return _NO_ACTION
        if m.battery_alarm == 0:
            m.battery_urgency = _LEAST_URGENT
        m.battery_alarm = alarm
        text = BATTERY_ALARM + (1 if alarm == CRITICAL_CHARGE else 0)
        say_figures(m, MAV_SEVERITY_WARNING, text, (m.battery_voltage, m.battery_used, 0.0, 0.0))
        action = int(m.BATT_FS_CRT_ACT if alarm == CRITICAL_CHARGE else m.BATT_FS_LOW_ACT)
        place = place_of(action)
        if place > m.battery_urgency:
            return _NO_ACTION
        m.battery_urgency = place
        return action

    return new_action


@kernel
def reset_battery(m: Any, mask: float, percentage: float, t: float) -> bool:
    """Handles BATTERY_RESET: battery 1, if it is in the mask, has this percentage left; returns whether it is known."""
    if not 0.0 <= percentage <= 100.0 or not 0.0 <= mask <= 65535.0:
        return False
    if (int(mask) & 1) != 0:
        m.battery_used = m.BATT_CAPACITY * (1.0 - 0.01 * percentage)
        m.battery_alarm = _alarm(m, t)
    return int(mask) <= 1


@kernel
def battery_permits_arming(m: Any) -> bool:
    """Returns whether the battery may be armed with; says why not."""
    if m.BATT_MONITOR == 0:
        return True
    v = m.battery_voltage
    low, critical = m.BATT_LOW_VOLT, m.BATT_CRT_VOLT
    failed = -1
    if v < m.BATT_ARM_VOLT:
        failed = 0
    elif _charge_below(m, m.BATT_ARM_MAH):
        failed = 1
    elif 0.0 < v < low:
        failed = 2
    elif _charge_below(m, m.BATT_LOW_MAH):
        failed = 3
    elif 0.0 < v < critical:
        failed = 4
    elif _charge_below(m, m.BATT_CRT_MAH):
        failed = 5
    elif m.BATT_CRT_MAH >= m.BATT_LOW_MAH > 0.0:
        failed = 6
    elif critical >= low > 0.0:
        failed = 7
    if failed >= 0:
        say(m, MAV_SEVERITY_CRITICAL, ARM_BATTERY + failed, 0)
    return failed < 0
