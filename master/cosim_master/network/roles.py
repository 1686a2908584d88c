"""Roles of the arrays of a run, declared with the arrays: they determine the contents of snapshots and checkpoints.

CONSTANT   the same from the first step to the last (or the same again in a new run of the system)
STATE      the future depends on it: in snapshots, and in the files of checkpoints
PASSING    changes, but is computed again when a run is resumed from files: in snapshots only
BUFFER     empty or meaningless whenever a snapshot is made
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["BUFFER", "CONSTANT", "PASSING", "STATE", "declared"]

CONSTANT, STATE, PASSING, BUFFER = "constant", "state", "passing", "buffer"


def declared(**names: str) -> Mapping[str, str]:
    """Returns the role of each array, given the names of those that have a role: ``STATE="real_in ports.filled"``."""
    known = {"CONSTANT": CONSTANT, "STATE": STATE, "PASSING": PASSING, "BUFFER": BUFFER}
    roles = [(name, known[role]) for role, text in names.items() for name in text.split()]
    assert len({name for name, _ in roles}) == len(roles), "a role is declared twice"
    return dict(roles)
