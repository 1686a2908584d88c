"""The actions during an earlier run, which another run repeats: values that were set, and packets of its mailbox.

The manifest of a run contains both: `changes` with their times, and `posted`, the packets that the live page or ROS
sent, with the times at which they entered the network. The same system with the same actions records the same bits.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["NOTHING", "Actions", "as_json", "as_text", "entering", "read_actions"]


@dataclass(frozen=True, slots=True)
class Actions:
    """What was done to a run.

    Attributes:
        at: values set, as (time in s, name, text), the form of `RunOptions.at`.
        posted: packets of the mailbox, as (time in s, packet).
    """

    at: Sequence[tuple[float, str, str]] = ()
    posted: Sequence[tuple[float, bytes]] = ()


NOTHING = Actions()


def read_actions(run: Path) -> Actions:
    """Returns the actions during the run in a folder.

    Raises:
        SystemDescriptionError: the folder has no manifest of a run that has ended.
    """
    try:
        manifest = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
        if manifest["outcome"] in ("running", "killed"):
            raise ValueError(f"the run is {manifest['outcome']}, so it is not known what was done to it")
        at = [(float(one["time"]), str(one["variable"]), as_text(one["value"])) for one in manifest["changes"]]
        posted = [(float(one["time"]), bytes.fromhex(one["packet"])) for one in manifest.get("posted", ())]
    except OSError as error:
        raise _refusal(run, f"manifest.json cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise _refusal(run, f"its manifest cannot be used: {error}") from None
    return Actions(at, posted)


def as_text(value: Any) -> str:
    """Returns a value of a manifest as `--at` reads it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def entering(posted: Sequence[tuple[float, bytes]], clock: TimeGrid) -> tuple[tuple[int, bytes], ...]:
    """Returns packets with the base steps at which they enter the network of another run.

    Raises:
        SystemDescriptionError: a packet is not sent at a communication point of this run.
    """
    found, first, last = [], clock.time(0), clock.time(clock.steps)
    for time, packet in posted:
        k = clock.step_at(time)
        if k is None:
            valid = f"the multiples of {clock.seconds(1):g} s from {first:g} to {last:g} s; give --step or --until"
            text = f"a packet was sent at {time:.12g} s, which is no communication point of this run; those are {valid}"
            raise SystemDescriptionError([Problem(Where("--replay"), text)])
        found.append((k, packet))
    return tuple(sorted(found, key=lambda one: one[0]))


def as_json(admitted: Sequence[tuple[int, bytes]], clock: TimeGrid) -> list[dict[str, Any]]:
    """Returns packets that have entered the network, as (k, packet), in the form of the manifest."""
    return [{"time": clock.time(k), "packet": packet.hex()} for k, packet in admitted]


def _refusal(run: Path, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(f"--replay {run}"), text)])
