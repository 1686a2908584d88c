"""The autopilot's kernels interpreted give the same bits as compiled, over a conversation and the begin of a flight."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.sensing.estimator import Estimator
from tests.models.copter import GUIDED, LAND, LOITER, RTL, Copter, H
from tests.models.shipped_kernels import kernels

ALT_HOLD, CIRCLE = (mavlink.COPTER_MODE_ALT_HOLD, mavlink.COPTER_MODE_CIRCLE)

ROOT = Path(__file__).parents[3]


def digest_of_a_flight() -> str:
    """Take-off, all kinds of targets, all modes and streams in little more than three seconds of flight."""
    copter = Copter(autopilot={"estimate_ready_time": 0.05, "MOT_SPOOL_TIME": 0.05, "TKOFF_SLEW_TIME": 0.2})
    hasher = hashlib.sha256()

    def fly(duration: float) -> None:
        hasher.update(copter.run(duration).tobytes())
        hasher.update(copter.m.tobytes())

    fly(0.06)
    for version in (1, 2):
        copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED, version=version)
    copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    for message in (1, 2, 24, 26, 29, 30, 32, 33, 36, 65, 74, 147, 152, 162, 163, 178, 193, 241, 242, 245):
        copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, 40000.0)
    copter.command(mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION)
    copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 4242, 1e6)
    fly(0.02)
    copter.m["armed_at"] = -2.0  # spare the interpreted run two seconds of waiting
    copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0)
    fly(0.9)
    copter.go(3.0, 2.0, -3.0)
    fly(0.3)
    copter.go(0.0, 0.0, 0.0, 0xDC7, 8, vx=1.0, vz=-0.5)
    fly(0.15)
    copter.go(1.0, 0.0, -2.0, 0x9C0, 1, vx=0.5, yaw=1.0)
    fly(0.1)
    copter.go(0.0, 0.0, 0.0, 0xC3F, 1, afx=0.5, afz=-0.2)
    fly(0.1)
    for mode in (LOITER, LAND, RTL, GUIDED, 77, 0):
        copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
        fly(0.08)
    for mode in (ALT_HOLD, LOITER, CIRCLE, 0):
        copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
        copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1600, 1350, 1570, 1720, *[65535] * 4))
        fly(0.1)
    copter.send(mavlink.MAVLink_manual_control_message(1, 300, -200, 600, 100, 0))
    name = b"@PARAM/param.pck"
    for opcode, data in ((4, name), (15, b"")):
        payload = bytes((1, 0, 7, opcode, len(data) or 239)).ljust(12, b"\0") + data
        copter.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload.ljust(251, b"\0"))))
    fly(0.03)
    hasher.update(bytes(copter.sent))
    assert copter.v["position"][2] < -0.05
    return hasher.hexdigest()


def digest_of_estimates() -> str:
    """Two seconds of an estimator whose vehicle turns and climbs."""
    m = Estimator.record()
    start, advance = kernels(Estimator)
    assert start(m) == 0
    for k in range(800):
        m["true_position"][2] = -0.1 * (k * H) ** 2
        m["true_velocity"][2] = -0.2 * k * H
        m["true_specific_force"][2] = -9.80665 - 0.2
        m["true_angular_velocity"][2] = 0.3
        m["true_attitude"][:] = (math.cos(0.15 * k * H), 0.0, 0.0, math.sin(0.15 * k * H))
        assert advance(m, k * H, H) == 0
    return hashlib.sha256(m.tobytes()).hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("digest", [digest_of_a_flight, digest_of_estimates])
def test_interpreted_and_compiled_kernels_give_the_same_bits(digest: Callable[[], str]) -> None:
    code = f"from tests.models.autopilot.test_autopilot_builds import {digest.__name__} as digest; print(digest())"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == digest()
