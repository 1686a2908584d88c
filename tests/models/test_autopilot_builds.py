"""The autopilot's kernels interpreted give the same bits as compiled, over a conversation and the begin of a flight."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.models.copter import GUIDED, LAND, LOITER, RTL, Copter

ROOT = Path(__file__).parents[2]


def digest_of_a_flight() -> str:
    """Take-off, all kinds of targets, all modes and streams in little more than three seconds of flight."""
    copter = Copter(autopilot={"estimate_ready_time": 0.05, "MOT_SPOOL_TIME": 0.05, "TKOFF_SLEW_TIME": 0.2})
    hasher = hashlib.sha256()

    def fly(duration: float) -> None:
        hasher.update(copter.run(duration).tobytes())
        hasher.update(copter.m.tobytes())

    fly(0.06)
    for version in (1, 2):
        copter.command(176, 1, GUIDED, version=version)
    copter.command(400, 1)
    for message in (1, 2, 24, 30, 32, 33, 36, 74, 193, 242, 245):
        copter.command(511, message, 40000.0)
    copter.command(519)
    copter.command(511, 4242, 1e6)
    fly(0.02)
    copter.m["armed_at"] = -2.0  # spare the interpreted run two seconds of waiting
    copter.command(22, 0, 0, 0, 0, 0, 0, 2.0)
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
        copter.command(176, 1, mode)
        fly(0.08)
    hasher.update(bytes(copter.sent))
    assert copter.v["position"][2] < -0.05
    return hasher.hexdigest()


@pytest.mark.slow
def test_interpreted_and_compiled_kernels_give_the_same_bits() -> None:
    code = "from tests.models.test_autopilot_builds import digest_of_a_flight; print(digest_of_a_flight())"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == digest_of_a_flight()
