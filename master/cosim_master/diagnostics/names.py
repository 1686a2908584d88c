"""Names by pattern: `*` matches any sequence of characters, including dots, and `?` matches any single character.

No other character is special: `[2]` is an index and braces are braces. Every name of a variable is therefore a pattern
that matches itself.
"""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

__all__ = ["alike", "did_you_mean", "divided", "is_pattern", "matching", "near", "near_pattern", "similar"]

_LISTED = 12
_SIMILAR = 3
_CLOSE = 0.6

_INDEX = re.compile(r"\[[0-9,]*\]$")

_NUMBER = re.compile(r"(?<![\[0-9,])[0-9]+(?![\],0-9])")
"""A number that is not an index."""


def is_pattern(text: str) -> bool:
    """Returns whether a text is a pattern of names rather than one name."""
    return "*" in text or "?" in text


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """Returns the names that match a pattern, in their original order."""
    if not is_pattern(pattern):
        return [name for name in names if name == pattern]
    match = _matcher(pattern)
    return [name for name in names if match(name)]


def divided(pattern: str, names: Sequence[str]) -> list[tuple[Callable[[str], object], list[str]]]:
    """Divides a pattern of names that begin with a prefix and end with one of `names`.

    Returns:
        The ways to divide it: whether a prefix matches the first part, and the names that match the rest. A prefix and
        a name match the whole pattern if they match in one of these ways.
    """
    if not is_pattern(pattern):
        known = {*names}
        return [(pattern[:i].__eq__, [pattern[i:]]) for i in range(len(pattern) + 1) if pattern[i:] in known]
    # A "*" may end the first part, begin the rest, or both.
    ends = [(i, j) for i in range(len(pattern) + 1) for j in ((i - 1, i) if pattern[i - 1 : i] == "*" else (i,))]
    found = ((_matcher(pattern[:end]), matching(pattern[begin:], names)) for end, begin in ends)
    return [(head, rest) for head, rest in found if rest]


@lru_cache(maxsize=4096)  # a study has the same patterns in all its runs
def _matcher(pattern: str) -> Callable[[str], object]:
    return re.compile(fnmatch.translate(pattern.replace("[", "[[]"))).match


def near(name: str, names: Iterable[str]) -> str:
    """Returns names that a user may have meant, as the end of a sentence: at most twelve, the most similar first."""
    known = list(dict.fromkeys(names))
    if not known:
        return "there is none"
    if close := similar(name, known):
        return did_you_mean(close)
    listed = ", ".join(f'"{item}"' for item in sorted(known)[:_LISTED])
    more = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    return f"valid: {listed}{more}"


def did_you_mean(names: Iterable[str]) -> str:
    """Returns the end of a sentence about names that a user may have meant."""
    return "did you mean " + " or ".join(f'"{name}"' for name in names) + "?"


def similar(name: str, names: Iterable[str]) -> list[str]:
    """Returns up to three names that are similar to one, the most similar first: those that are `alike`, or differ in
    a few letters."""
    known = list(names)
    if found := alike(name, known):
        return found
    match = difflib.SequenceMatcher(b=name)
    ratios: dict[str, float] = {}
    for one in known:
        match.set_seq1(one)
        if match.real_quick_ratio() >= _CLOSE and match.quick_ratio() >= _CLOSE and (ratio := match.ratio()) >= _CLOSE:
            ratios[one] = ratio
    # Long common prefixes make all names similar, so only the names about as similar as the most similar one are kept.
    kept = [one for one, ratio in ratios.items() if ratio > max(ratios.values()) - 0.05]
    beside = [one for one in kept if _parent(one) == _parent(name)]
    return sorted(beside or kept, key=lambda one: -ratios[one])[:_SIMILAR]


def alike(name: str, names: Iterable[str]) -> list[str]:
    """Returns up to three names that are one but for its case, an index, or omitted levels, in their original order.

    An array, or an element that it does not have, is alike to its elements; "mass" and "a.mass" to "a.b.mass".
    """
    known = {one: one.casefold() for one in names}
    folded = name.casefold()
    array = _INDEX.sub("", folded)
    first, _, last = folded.rpartition(".")
    kinds: tuple[Callable[[str], bool], ...] = (
        lambda other: other == folded and name not in known,
        lambda other: other != array and _INDEX.sub("", other) == array,
        lambda other: other.endswith(f".{folded}"),
        lambda other: first != "" and other.startswith(f"{first}.") and other.endswith(f".{last}"),
    )
    for fits in kinds:
        if found := [one for one, other in known.items() if fits(other)]:
            return found[:_SIMILAR]
    return []


def _parent(name: str) -> str:
    return name.rpartition(".")[0]


def near_pattern(pattern: str, names: Iterable[str]) -> str:
    """Returns patterns that a user may have meant instead of one without a match, as the end of a sentence.

    Names that differ only in their numbers, as in a swarm, are combined: "drone*.vehicle.mass".
    """
    alike: dict[str, list[str]] = {}
    for name in names:
        alike.setdefault(_NUMBER.sub("*", name), []).append(name)
    return near(pattern, (shape if len(found) > 1 else found[0] for shape, found in alike.items()))
