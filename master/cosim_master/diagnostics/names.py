"""Names by pattern: `*` is any run of characters, dots too, and `?` any one. Nothing else is special.

`[2]` stays an index and braces stay braces, so that every name of a variable is a pattern for itself.
"""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Iterable

__all__ = ["is_pattern", "matching", "near", "near_pattern"]

_LISTED = 12

_NUMBER = re.compile(r"(?<![\[0-9,])[0-9]+(?![\],0-9])")
"""A number that is not an index."""


def is_pattern(text: str) -> bool:
    """Returns whether a text is a pattern of names rather than one name."""
    return "*" in text or "?" in text


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that a pattern matches, in their order."""
    match = re.compile(fnmatch.translate(pattern.replace("[", "[[]"))).match
    return [name for name in names if match(name)]


def near(name: str, names: Iterable[str]) -> str:
    """The names a user may have meant, as the end of a sentence: near matches first, at most twelve."""
    known = list(dict.fromkeys(names))
    if not known:
        return "there is none"
    if close := difflib.get_close_matches(name, known, n=3, cutoff=0.6):
        # Long common prefixes make everything similar, so that only what is as near as the nearest is meant.
        ratios = [difflib.SequenceMatcher(None, name, match).ratio() for match in close]
        close = [match for match, ratio in zip(close, ratios, strict=True) if ratio > ratios[0] - 0.05]
        return "did you mean " + " or ".join(f'"{match}"' for match in close) + "?"
    listed = ", ".join(f'"{item}"' for item in sorted(known)[:_LISTED])
    more = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    return f"valid: {listed}{more}"


def near_pattern(pattern: str, names: Iterable[str]) -> str:
    """The patterns a user may have meant by one that matches none of the names, as the end of a sentence.

    Names that differ in numbers alone, as those of a swarm do, are taken together: "drone*.vehicle.mass".
    """
    alike: dict[str, list[str]] = {}
    for name in names:
        alike.setdefault(_NUMBER.sub("*", name), []).append(name)
    return near(pattern, (shape if len(found) > 1 else found[0] for shape, found in alike.items()))
