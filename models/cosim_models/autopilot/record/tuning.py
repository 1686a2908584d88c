"""Memory of AUTOTUNE (`flight.tuning`).

This module contains no computation.
"""

from __future__ import annotations

from dataclasses import replace

from cosim import Memory, State

__all__ = ["GAINS", "TUNING_MEMORY"]

GAINS = 8
"""Gains of an axis that a tune sets."""

TUNING_MEMORY = (
    Memory("tune_stage", dtype="i4", rare=True),
    Memory("tune_step", dtype="i4", rare=True),
    Memory("tune_axis", dtype="i4", rare=True),
    Memory("tune_kind", dtype="i4", rare=True),  # of the twitches: what they tune
    Memory("tune_completed", dtype="i4", rare=True),  # axes, bits of AUTOTUNE_AXES
    Memory("tune_gains", dtype="i4", rare=True),  # set of gains that is loaded
    Memory("tune_successes", dtype="i4", rare=True),
    Memory("tune_skips", dtype="?", rare=True),  # the next contrary result does not count
    Memory("tune_right", dtype="?", rare=True),  # the next twitch is in the positive direction
    Memory("tune_stepped", dtype="?", rare=True),  # the angle of this twitch has been demanded
    Memory("tune_overridden", dtype="?", rare=True),  # the pilot flies
    Memory("tune_holds", dtype="?", rare=True),  # the place is held between twitches
    Memory("tune_placed", dtype="?", rare=True),
    Memory("tune_tested", dtype="?", rare=True),  # the switch of the gains has been used
    Memory("tune_unsent", dtype="i4", rare=True),  # saved parameters that are not reported, bits
    Memory("tune_since", rare=True),  # of the step
    Memory("tune_levelling_since", rare=True),
    Memory("tune_limit", rare=True),  # duration of the twitch, s
    Memory("tune_announced_at", rare=True),
    Memory("tune_overridden_at", rare=True),
    Memory("tune_warned_at", rare=True),
    Memory("tune_lean", shape=3, rare=True),  # roll, pitch and heading between twitches, rad
    Memory("tune_place", shape=2, rare=True),
    Memory("tune_begin", shape=2, rare=True),  # angle and rate at the begin of the twitch
    Memory("tune_target", shape=2, rare=True),  # rate and angle of the twitch
    Memory("tune_scale", rare=True),  # of the target rate
    Memory("tune_rate", rare=True),  # filtered, in the direction of the twitch
    Memory("tune_rates", shape=2, rare=True),  # greatest, and least after it
    Memory("tune_angles", shape=2, rare=True),
    Memory("tune_accel", rare=True),  # mean acceleration to the greatest rate, rad/s2
    Memory("tune_accel_rate", rare=True),  # to which it belongs
    Memory("tune_before", shape=(3, GAINS), rare=True),
    Memory("tune_found", shape=(3, GAINS), rare=True),
    replace(State("tuned", shape=10, description="last twitch of AUTOTUNE, as ATUN of a log, rad"), rare=True),
    replace(State("tuning", shape=3, description="twitch of AUTOTUNE: 1 during one; angle, rate, rad"), rare=True),
)
