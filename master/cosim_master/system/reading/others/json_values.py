"""Values of JSON: checks of their validity, and their representation in messages."""

from __future__ import annotations

import json
import math
from typing import Any

__all__ = ["finite", "shown", "speakable"]


def finite(value: float) -> bool:
    """Returns whether a number is also finite as a double."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def speakable(text: str) -> bool:
    """Returns whether a text is valid: JSON allows half surrogate pairs, and XML allows no control characters."""
    return all(character >= " " and not "\ud800" <= character <= "\udfff" for character in text)


def shown(value: Any) -> str:
    """Returns the value as JSON, shortened."""
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
