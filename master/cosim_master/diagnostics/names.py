"""Names by pattern: `*` matches any sequence of characters, including dots, and `?` matches any single character.

No other character is special: `[2]` is an index and braces are braces. Every name of a variable is therefore a pattern
that matches itself.
"""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Iterable

__all__ = ["is_pattern", "matching", "near", "near_pattern", "similar"]

_LISTED = 12

_NUMBER = re.compile(r"(?<![\[0-9,])[0-9]+(?![\],0-9])")
"""A number that is not an index."""


def is_pattern(text: str) -> bool:
    """Returns whether a text is a pattern of names rather than one name."""
    return "*" in text or "?" in text


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """Returns the names that match a pattern, in their original order."""
    match = re.compile(fnmatch.translate(pattern.replace("[", "[[]"))).match
    return [name for name in names if match(name)]


def near(name: str, names: Iterable[str]) -> str:
    """Returns names that a user may have meant, as the end of a sentence: at most twelve, the most similar first."""
    known = list(dict.fromkeys(names))
    if not known:
        return "there is none"
    if close := similar(name, known):
        return "did you mean " + " or ".join(f'"{match}"' for match in close) + "?"
    listed = ", ".join(f'"{item}"' for item in sorted(known)[:_LISTED])
    more = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    return f"valid: {listed}{more}"


def similar(name: str, names: Iterable[str]) -> list[str]:
    """Returns up to three names that are similar to one, the most similar first.

    Upper and lower case are alike. The end of a hierarchical name ("mass") is similar to the whole ("a.b.mass").
    """
    known = {one: one.casefold() for one in names}
    exact = [one for one, folded in known.items() if folded == name.casefold()]
    if exact and name not in known:
        return exact[:3]
    if ends := [one for one in known if one.endswith(f".{name}")]:
        return ends[:3]
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    # Long common prefixes make all names similar, so only the names about as similar as the most similar one are kept.
    ratios = [difflib.SequenceMatcher(None, name, match).ratio() for match in close]
    return [match for match, ratio in zip(close, ratios, strict=True) if ratio > ratios[0] - 0.05]


def near_pattern(pattern: str, names: Iterable[str]) -> str:
    """Returns patterns that a user may have meant instead of one without a match, as the end of a sentence.

    Names that differ only in their numbers, as in a swarm, are combined: "drone*.vehicle.mass".
    """
    alike: dict[str, list[str]] = {}
    for name in names:
        alike.setdefault(_NUMBER.sub("*", name), []).append(name)
    return near(pattern, (shape if len(found) > 1 else found[0] for shape, found in alike.items()))
