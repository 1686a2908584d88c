"""Reads the elements of our own annotations: typed attributes, and every problem with its line.

A run may override attributes (`CheckedSystem.settings`): its values replace the written values, or the defaults if the
annotation does not exist.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lxml import etree

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.diagnostics.names import near, similar
from cosim_master.files.xml import line_of, plain_number, whole
from cosim_master.system.flatten.flat import CheckedSystem

__all__ = ["NAMESPACE", "Attributes", "root_annotation"]

NAMESPACE = "https://uav-cosim.org/ns/1"
_OPTION = Where("--set")


class Attributes:
    """The attributes of one element (without one: all defaults). Problems are added to a list shared by all readers.

    Args:
        given: attributes that a run overrides, by name, as text.
        tag: tag of the element, and prefix of overridden attributes: "network" for "network.loss".
    """

    def __init__(
        self,
        element: etree._Element | None,
        where: Where,
        problems: list[Problem],
        given: Mapping[str, str] | None = None,
        tag: str = "",
    ) -> None:
        self.element = element
        self.where = where
        self.problems = problems
        self._given = dict(given or {})
        self._tag = tag
        self._read: set[str] = set()

    @property
    def absent(self) -> bool:
        """True if neither the element nor an attribute from the run's options is present."""
        return self.element is None and not self._given

    def overridden(self, name: str) -> bool:
        """Returns whether the run's options give this attribute."""
        return name in self._given

    def problem(self, message: str, *about: str) -> None:
        """Adds a problem at the element's line, or at the option if there is no element, or if a run gives `about`.

        Args:
            about: the attributes that do not fit together.
        """
        line = line_of(self.element) if self.element is not None else self.where.line
        is_given = any(name in self._given for name in about) or (self.element is None and bool(self._given))
        self.problems.append(Problem(_OPTION if is_given else Where(self.where.path, line), message))

    def _wrong(self, name: str, text: str, expected: str) -> None:
        if name in self._given:
            self.problems.append(Problem(_OPTION, f"{self._tag}.{name}={text}{expected}"))
        else:
            self.problem(f'{name}="{text}"{expected}')

    def text(self, name: str, default: str) -> str:
        """Returns an attribute as written."""
        self._read.add(name)
        written = default if self.element is None else self.element.get(name, default)
        return self._given.get(name, written)

    def _has(self, name: str) -> bool:
        self._read.add(name)
        return name in self._given or (self.element is not None and name in self.element.attrib)

    def optional(self, name: str, low: float, high: float) -> float | None:
        """Returns a number as `number` does, or None if the attribute is missing."""
        return self.number(name, low, low, high) if self._has(name) else None

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """Returns a number between `low` and `high`; INF is infinity, as in XML Schema."""
        text = self.text(name, "").strip()
        if not self._has(name):
            return default
        try:
            value = math.inf if text == "INF" else plain_number(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            self._wrong(name, text, f" must be a number from {low:g} to {high:g}")
            return default
        return value

    def integer(self, name: str, default: int, low: int, high: int) -> int:
        """Returns an integer between `low` and `high`."""
        text = self.text(name, "").strip()
        if not self._has(name):
            return default
        value = whole(text, low, high)
        if value is None:
            self._wrong(name, text, f" must be a whole number from {low} to {high}")
            return default
        return value

    def choice(self, name: str, default: str, valid: tuple[str, ...]) -> str:
        text = self.text(name, default)
        if text not in valid:
            self._wrong(name, text, f": valid are {', '.join(valid)}")
            return default
        return text

    def children(self, *tags: str) -> dict[str, list[Attributes]]:
        """Yields readers of the children by tag; a child with another tag is a problem."""
        found: dict[str, list[Attributes]] = {tag: [] for tag in tags}
        for child in () if self.element is None else self.element:
            if not isinstance(child.tag, str):
                continue
            name = etree.QName(child)
            if name.namespace != NAMESPACE or name.localname not in found:
                self.problem(f"<{name.localname}> is unknown here: valid are {', '.join(tags) or 'no elements'}")
            else:
                found[name.localname].append(Attributes(child, self.where, self.problems))
        return found

    def finish(self) -> None:
        """Adds a problem for each attribute that was never read."""
        unknown = [] if self.element is None else sorted(set(map(str, self.element.attrib)) - self._read)
        if unknown:
            meant = [one for name in unknown for one in similar(name, sorted(self._read))[:1]]
            hint = f"; did you mean {' and '.join(meant)}?" if meant else ""
            self.problem(f"attribute {', '.join(unknown)}: valid are {', '.join(sorted(self._read))}{hint}")
        for name in sorted(self._given.keys() - self._read):
            hint = near(f"{self._tag}.{name}", (f"{self._tag}.{one}" for one in self._read))
            self.problems.append(Problem(_OPTION, f'there is no setting "{self._tag}.{name}"; {hint}'))


def root_annotation(checked: CheckedSystem, type: str, tag: str, problems: list[Problem]) -> Attributes:
    """Returns the only element `tag` of an annotation of the root system or of the description itself.

    Attributes that the run sets for this tag override the written ones.
    """
    given = checked.settings.get(tag, {})
    owned = [one for one in checked.annotations if one.annotation.type == type]
    for one in owned:
        if one.owner:
            problems.append(Problem(one.annotation.where, f"{type} belongs to the root system, not to {one.owner}"))
    at_root = [one.annotation for one in owned if not one.owner]
    if not at_root:
        return Attributes(None, Where(""), problems, given, tag)
    for extra in at_root[1:]:
        problems.append(Problem(extra.where, f"a second {type}; the first is at {at_root[0].where}"))
    first = at_root[0]
    children = [child for child in first.element if isinstance(child.tag, str)]
    if len(children) != 1 or children[0].tag != f"{{{NAMESPACE}}}{tag}":
        problems.append(Problem(first.where, f'this annotation must hold one <{tag} xmlns="{NAMESPACE}">'))
        return Attributes(None, first.where, problems, given, tag)
    return Attributes(children[0], first.where, problems, given, tag)
