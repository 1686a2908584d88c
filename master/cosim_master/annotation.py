"""Reading the elements of our own annotations: typed attributes, and every problem with its line."""

from __future__ import annotations

import math

from lxml import etree

from cosim_master.check import CheckedSystem
from cosim_master.document import line_of
from cosim_master.errors import Problem, Where

__all__ = ["NAMESPACE", "Attributes", "root_annotation"]

NAMESPACE = "https://uav-cosim.org/ns/1"


class Attributes:
    """The attributes of one element (of none: all defaults). Problems go into a list shared by all readers."""

    def __init__(self, element: etree._Element | None, where: Where, problems: list[Problem]) -> None:
        self.element = element
        self.where = where
        self.problems = problems
        self._read: set[str] = set()

    def problem(self, message: str) -> None:
        line = line_of(self.element) if self.element is not None else self.where.line
        self.problems.append(Problem(Where(self.where.path, line), message))

    def text(self, name: str, default: str) -> str:
        self._read.add(name)
        return default if self.element is None else self.element.get(name, default)

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """A number from low to high; INF is infinity, as in XML Schema."""
        text = self.text(name, "").strip()
        if not text:
            return default
        try:
            value = math.inf if text == "INF" else float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            self.problem(f'{name}="{text}" must be a number from {low:g} to {high:g}')
            return default
        return value

    def integer(self, name: str, default: int, low: int, high: int) -> int:
        """A whole number from low to high."""
        text = self.text(name, "").strip()
        if not text:
            return default
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            self.problem(f'{name}="{text}" must be a whole number from {low} to {high}')
            return default
        return value

    def choice(self, name: str, default: str, valid: tuple[str, ...]) -> str:
        text = self.text(name, default)
        if text not in valid:
            self.problem(f'{name}="{text}": valid are {", ".join(valid)}')
            return default
        return text

    def children(self, *tags: str) -> dict[str, list[Attributes]]:
        """Readers of the children by tag; a child with another tag is a problem."""
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
        """Complain about attributes that nobody has asked for."""
        unknown = [] if self.element is None else sorted(set(map(str, self.element.attrib)) - self._read)
        if unknown:
            self.problem(f"attribute {', '.join(unknown)}: valid are {', '.join(sorted(self._read))}")


def root_annotation(checked: CheckedSystem, type: str, tag: str, problems: list[Problem]) -> Attributes:
    """The one element `tag` of an annotation that belongs to the root system or to the description itself."""
    owned = [one for one in checked.annotations if one.annotation.type == type]
    for one in owned:
        if one.owner:
            problems.append(Problem(one.annotation.where, f"{type} belongs to the root system, not to {one.owner}"))
    at_root = [one.annotation for one in owned if not one.owner]
    if not at_root:
        return Attributes(None, Where(""), problems)
    for extra in at_root[1:]:
        problems.append(Problem(extra.where, f"a second {type}; the first is at {at_root[0].where}"))
    first = at_root[0]
    children = [child for child in first.element if isinstance(child.tag, str)]
    if len(children) != 1 or children[0].tag != f"{{{NAMESPACE}}}{tag}":
        problems.append(Problem(first.where, f'this annotation must hold one <{tag} xmlns="{NAMESPACE}">'))
        return Attributes(None, first.where, problems)
    return Attributes(children[0], first.where, problems)
