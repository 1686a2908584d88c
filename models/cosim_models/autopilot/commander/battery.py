"""A simple battery model and the low-battery fail-safes.

The current follows the throttle: it is `hover_current` in hover and proportional to the power for thrust, throttle to
the power of 1.5 (momentum theory). With SIM_BATT_CAP_AH = 0, the voltage stays at SIM_BATT_VOLTAGE, as in a simulated
ArduCopter by default. Otherwise, the open-circuit voltage follows the discharge curve of a lithium-polymer cell, and
the load drops it by `battery_resistance` times the current. Such a battery does not weaken the motors; a `PowerSystem`
does, whose voltage and current replace those of this model if they are connected. The battery is checked ten times a
second. Kernels over the autopilot's record `m`.

Sources: ArduPilot, AP_BattMonitor (update_failsafes, check_failsafes); the discharge curve is a typical one of
lithium-polymer cells at rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim_models.autopilot.control.motors import GROUND_IDLE
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.link.statustext import BATTERY_CRITICAL, BATTERY_LOW, WARNING, say_with

__all__ = ["CRITICAL_CHARGE", "LOW_CHARGE", "battery_remaining", "drain", "is_below", "new_alarm"]
__all__ += ["reset_battery"]

LOW_CHARGE, CRITICAL_CHARGE = 1, 2
"""Battery alarms."""

_CELL = 4.2  # V, full
# Remaining charge and open-circuit voltage of a cell.
_CHARGE = np.array((0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0))
_AT_REST = np.array((3.0, 3.45, 3.68, 3.74, 3.77, 3.79, 3.82, 3.87, 3.92, 3.98, 4.06, 4.2))
_MILLIAMPERE_HOUR = 3.6  # A s


@kernel
def _share_at_rest(charge: float) -> float:
    """Returns the open-circuit voltage at `charge` (0 to 1), relative to that of a full battery."""
    i = 1
    while i < _CHARGE.shape[0] - 1 and charge > _CHARGE[i]:
        i += 1
    part = (charge - _CHARGE[i - 1]) / (_CHARGE[i] - _CHARGE[i - 1])
    return float((_AT_REST[i - 1] + part * (_AT_REST[i] - _AT_REST[i - 1])) / _CELL)


@kernel
def drain(m: Any, dt: float) -> None:
    """Updates m.battery_voltage [V], _current [A], _used [mAh] and _energy [J] for the motors' consumption over dt."""
    if m.supply_voltage >= 0.0:
        m.battery_voltage = m.supply_voltage
        m.battery_current = m.supply_current
        m.battery_used += m.supply_current * dt / _MILLIAMPERE_HOUR
        m.battery_energy += m.supply_voltage * m.supply_current * dt
        return
    current = 0.0
    if m.armed and m.spool_state > GROUND_IDLE and m.throttle_hover > 0.0:
        load = clip(m.throttle_out / m.throttle_hover, 0.0, 10.0)
        current = m.hover_current * load**1.5
    m.battery_current = current
    voltage = m.SIM_BATT_VOLTAGE
    if m.SIM_BATT_CAP_AH > 0.0:
        left = clip(1.0 - 0.001 * m.battery_used / m.SIM_BATT_CAP_AH, 0.0, 1.0)
        voltage = max(voltage * _share_at_rest(left) - m.battery_resistance * current, 0.0)
    m.battery_voltage = voltage
    m.battery_used += current * dt / _MILLIAMPERE_HOUR
    m.battery_energy += voltage * current * dt


@kernel
def battery_remaining(m: Any) -> int:
    """Returns the remaining per cent of BATT_CAPACITY, or -1 if unknown."""
    if m.BATT_CAPACITY <= 0.0:
        return -1
    return int(clip(100.0 * (1.0 - m.battery_used / m.BATT_CAPACITY), 0.0, 100.0))


@kernel
def is_below(m: Any, row: int, voltage: float, least: float, t: float) -> bool:
    """Returns whether the voltage has been below `least` for BATT_LOW_TIMER."""
    if least <= 0.0 or not 0.0 < voltage < least:
        m.battery_since[row] = -1.0
        return False
    if m.battery_since[row] < 0.0:
        m.battery_since[row] = t
    return bool(m.BATT_LOW_TIMER > 0.0 and t - m.battery_since[row] > m.BATT_LOW_TIMER)


@kernel
def _alarm(m: Any, t: float) -> int:
    """Returns the alarm that voltage and charge raise now, 0: none."""
    voltage = m.battery_voltage
    if m.BATT_FS_VOLTSRC == 1:
        voltage += m.battery_resistance * m.battery_current if m.SIM_BATT_CAP_AH > 0.0 else 0.0
    left = m.BATT_CAPACITY - m.battery_used
    alarm = 0
    if is_below(m, 0, voltage, m.BATT_LOW_VOLT, t) or (m.BATT_LOW_MAH > 0.0 and left < m.BATT_LOW_MAH):
        alarm = LOW_CHARGE
    if is_below(m, 1, voltage, m.BATT_CRT_VOLT, t) or (m.BATT_CRT_MAH > 0.0 and left < m.BATT_CRT_MAH):
        alarm = CRITICAL_CHARGE
    return alarm


@kernel
def new_alarm(m: Any, t: float) -> int:
    """Returns LOW_CHARGE or CRITICAL_CHARGE when that alarm has just been raised, else 0; sends a status text."""
    alarm = _alarm(m, t)
    if not m.armed or alarm <= m.battery_alarm:
        return 0
    m.battery_alarm = alarm
    text = BATTERY_CRITICAL if alarm == CRITICAL_CHARGE else BATTERY_LOW
    say_with(m, WARNING, text, int(m.battery_used + 0.5), int(100.0 * m.battery_voltage + 0.5))
    return alarm


@kernel
def reset_battery(m: Any, mask: float, percentage: float, t: float) -> bool:
    """Handles BATTERY_RESET: battery 1, if it is in the mask of batteries, has this percentage left.

    Its alarm is that of its new state. Returns whether the percentage is known.
    """
    if not 0.0 <= percentage <= 100.0 or mask != mask:
        return False
    if (int(clip(mask, -1.0, 65535.0)) & 1) != 0:
        m.battery_used = m.BATT_CAPACITY * (1.0 - 0.01 * percentage)
        m.battery_alarm = _alarm(m, t)
    return True
