"""The error of a study that cannot be carried out, and of what is given for one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where

__all__ = ["refusal", "several"]


def refusal(subject: str, text: str) -> SystemDescriptionError:
    """Returns the error about a part of a study ("--vary x=1") or its folder; the text ends with a remedy."""
    return SystemDescriptionError([Problem(Where(subject), text)])


def several(subject: str, given: Any, example: str) -> tuple[Any, ...]:
    """Returns the items of a sequence or an array.

    Args:
        example: what else to give.

    Raises:
        SystemDescriptionError: it is one text or no sequence.
    """
    is_array = isinstance(given, np.ndarray) and given.ndim > 0
    if not is_array and (isinstance(given, str | bytes) or not isinstance(given, Sequence)):
        raise refusal(subject, f"is {given!r}, not a sequence; try {example}")
    return tuple(given)
