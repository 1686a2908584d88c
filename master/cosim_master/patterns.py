"""Names by pattern: `*` is any run of characters, dots too, and `?` any one. Nothing else is special.

`[2]` stays an index and braces stay braces, so that every name of a variable is a pattern for itself.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterable

from cosim_master.document import near

__all__ = ["is_pattern", "matching", "near_pattern"]

_NUMBER = re.compile(r"(?<![\[0-9,])[0-9]+(?![\],0-9])")
"""A number that is not an index."""


def is_pattern(text: str) -> bool:
    """Whether a text stands for the names that it matches, and not for one name."""
    return "*" in text or "?" in text


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that a pattern matches, in their order."""
    match = re.compile(fnmatch.translate(pattern.replace("[", "[[]"))).match
    return [name for name in names if match(name)]


def near_pattern(pattern: str, names: Iterable[str]) -> str:
    """The patterns a user may have meant by one that matches none of the names, as the end of a sentence.

    Names that differ in numbers alone, as those of a swarm do, are taken together: "drone*.vehicle.mass".
    """
    alike: dict[str, list[str]] = {}
    for name in names:
        alike.setdefault(_NUMBER.sub("*", name), []).append(name)
    return near(pattern, (shape if len(found) > 1 else found[0] for shape, found in alike.items()))
