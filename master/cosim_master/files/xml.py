"""XML documents with line numbers, and the grammar that they are checked against.

`parse` reads bytes into an lxml tree and never opens another file: document types, entities, network access, and a
depth or size that libxml2 considers huge are refused. `Grammar` defines for each element the legal attributes and
children, their order, and those that the standard defines but we do not support yet. Without this check, a misspelt
setting would silently have no effect. This module does not depend on SSP, whose grammar is in
`system.reading.ssp.grammar`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, cast

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import near

__all__ = ["Form", "Grammar", "Reader", "double", "line_of", "local_name", "parse", "whole"]

_XSI = "{http://www.w3.org/2001/XMLSchema-instance}"
_DOUBLE = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|-?INF|NaN")
_INTEGER = re.compile(r"[+-]?\d+")
_LATER = "is of SSP 2.0, but the file says that it is of version 1"


def local_name(element: etree._Element) -> str:
    """Returns the name of an element without its namespace."""
    return str(element.tag).rpartition("}")[2]


def line_of(element: etree._Element) -> int | None:
    """Returns the line of an element's start tag in its file."""
    return cast("int | None", element.sourceline)


def parse(data: bytes, shown: str) -> etree._Element:
    """Returns the root element of an XML document.

    Args:
        data: the document.
        shown: its file, as the user would name it.

    Raises:
        SystemDescriptionError: the document is not well-formed (reported with the line), or has a document type
            declaration.
    """
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True, huge_tree=False
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        line = error.lineno or None
        raise SystemDescriptionError([Problem(Where(shown, line), f"not well-formed XML: {error.msg}")]) from error
    except ValueError as error:
        raise SystemDescriptionError([Problem(Where(shown), f"not well-formed XML: {error}")]) from error
    if root.getroottree().docinfo.internalDTD is not None:
        message = "has a document type declaration (DOCTYPE); it and its entities are not read, remove it"
        raise SystemDescriptionError([Problem(Where(shown, 1), message)])
    return root


@dataclass(frozen=True, slots=True)
class Form:
    """The attributes and children that an element may have.

    Attributes:
        required: attributes that must be present.
        optional: attributes that may be present.
        children: legal child elements, as "{namespace}name", in the standard's order.
        repeated: those of `children` that may occur more than once.
        mandatory: those of `children` that must be present.
        filled: at least one child must be present, and repeated children may be in any order.
        unordered: all children may be in any order.
        choices: sets of `children`, of which at most one element may be present.
        later: attributes and children that only version 2 of the standard defines.
        opaque: the children belong to another tool and are ignored.
        free: the attributes are not checked either.
        ranks: places of `children` in their order; equal for those that may be in any order.
    """

    required: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    children: tuple[str, ...] = ()
    repeated: frozenset[str] = frozenset()
    mandatory: tuple[str, ...] = ()
    filled: bool = False
    unordered: bool = False
    choices: tuple[frozenset[str], ...] = ()
    later: frozenset[str] = frozenset()
    opaque: bool = False
    free: bool = False
    ranks: Mapping[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranks", {tag: self._rank(tag) for tag in self.children})

    def _rank(self, tag: str) -> int:
        if self.unordered:
            return 0
        for choice in self.choices:
            if tag in choice:
                return min(self.children.index(member) for member in choice)
        if tag in self.repeated and self.filled:
            return min(self.children.index(member) for member in self.repeated)
        return self.children.index(tag)


Grammar: TypeAlias = Mapping[str, Form]
"""The form of every element, by its "{namespace}name"."""


class Reader:
    """Reads attributes and children of one document and collects its problems instead of raising them.

    After a problem, every accessor returns a usable value, so that one pass finds all problems of a document. Such a
    value only serves to find further problems.
    """

    def __init__(self, shown: str, problems: list[Problem], version: int = 2) -> None:
        self.shown = shown
        self.version = version
        self.problems = problems

    def where(self, element: etree._Element) -> Where:
        return Where(self.shown, line_of(element))

    def problem(self, element: etree._Element, message: str) -> None:
        self.problems.append(Problem(self.where(element), message))

    def children(self, element: etree._Element, form: Form) -> Sequence[etree._Element]:
        """Returns the legal, supported children of `element`; reports everything in it that `form` does not allow."""
        if not form.free:
            self._attributes(element, form)
        if form.opaque:
            return ()
        if element.text and element.text.strip():
            self.problem(element, f'unexpected text "{element.text.strip()[:40]}" in <{local_name(element)}>')
        return self._children(element, form)

    def _attributes(self, element: etree._Element, form: Form) -> None:
        attributes = [*map(str, element.keys())]
        for attribute in attributes:
            if attribute in form.required or attribute in form.optional:
                if attribute in form.later and self.version < 2:
                    self.problem(element, f'attribute "{attribute}" of <{local_name(element)}> {_LATER}')
            elif not attribute.startswith(_XSI):
                hint = near(attribute, form.required + form.optional)
                self.problem(element, f'<{local_name(element)}> has no attribute "{attribute}"; {hint}')
        for attribute in form.required:
            if attribute not in attributes:
                self.problem(element, f'<{local_name(element)}> needs the attribute "{attribute}"')

    def _children(self, element: etree._Element, form: Form) -> Sequence[etree._Element]:
        accepted, reached = [], -1
        seen: dict[str, etree._Element] = {}
        for child in element:
            tag = str(child.tag)
            if tag in form.later and self.version < 2:
                self.problem(child, f"<{local_name(child)}> in <{local_name(element)}> {_LATER}")
                continue
            if tag not in form.children:
                self.problem(child, self._unknown_child(child, local_name(element), form))
                continue
            if tag in seen and tag not in form.repeated:
                self.problem(child, f"<{local_name(element)}> may hold only one <{local_name(child)}>")
                continue
            rank = form.ranks[tag]
            if rank < reached:
                name = local_name(element)
                self.problem(child, f"<{local_name(child)}> in <{name}> comes too late; order: {_order(form)}")
            reached = max(reached, rank)
            accepted.append(child)
            seen.setdefault(tag, child)
        for tag in form.mandatory:
            if tag not in seen:
                self.problem(element, f"<{local_name(element)}> needs a <{etree.QName(tag).localname}>")
        if form.filled and not len(element):
            names = " or ".join(f"<{etree.QName(tag).localname}>" for tag in form.children)
            self.problem(element, f"<{local_name(element)}> is empty; it needs a {names}")
        for choice in form.choices:
            if len(several := [tag for tag in seen if tag in choice]) > 1:
                names = " and ".join(f"<{etree.QName(tag).localname}>" for tag in several)
                name = local_name(element)
                self.problem(seen[several[-1]], f"<{name}> holds {names}; only one of them is allowed")
        return accepted

    def _unknown_child(self, child: etree._Element, parent: str, form: Form) -> str:
        name, namespace = local_name(child), etree.QName(child).namespace
        for tag in form.children:
            if etree.QName(tag).localname == name:
                wanted = etree.QName(tag).namespace
                return f'<{name}> in <{parent}> is in the namespace "{namespace or ""}"; it must be in "{wanted}"'
        return f"<{parent}> holds no <{name}>; " + near(name, (etree.QName(tag).localname for tag in form.children))

    def text(self, element: etree._Element, attribute: str, default: str = "") -> str:
        value = element.get(attribute)
        return default if value is None else value

    def name(self, element: etree._Element, attribute: str = "name") -> str:
        """Returns a name, which must not be empty. The grammar has already reported a missing name."""
        value = element.get(attribute)
        if value == "":
            self.problem(element, f'attribute "{attribute}" of <{local_name(element)}> is empty')
        return value or ""

    def choice(self, element: etree._Element, attribute: str, valid: Sequence[str], default: str) -> str:
        value = element.get(attribute, default)
        if value not in valid:
            listed = ", ".join(f'"{item}"' for item in valid)
            self.problem(element, f'attribute "{attribute}" of <{local_name(element)}> is "{value}"; valid: {listed}')
            return default
        return value

    def real(self, element: etree._Element, attribute: str, default: float = math.nan) -> float:
        value = element.get(attribute)
        if value is None:
            return default
        number = double(value)
        if number is None:
            self.malformed(element, attribute, value, "a number (xs:double)")
            return default
        return number

    def integer(
        self, element: etree._Element, attribute: str, default: int = 0, *, low: int = -(2**31), high: int = 2**31 - 1
    ) -> int:
        """Returns an integer between `low` and `high`, by default a 32-bit integer."""
        value = element.get(attribute)
        if value is None:
            return default
        number = whole(value, low, high)
        if number is None:
            wanted = "an integer of 32 bits (xs:int)" if (low, high) == (-(2**31), 2**31 - 1) else _between(low, high)
            self.malformed(element, attribute, value, wanted)
            return default
        return number

    def boolean(self, element: etree._Element, attribute: str, default: bool = False) -> bool:
        value = element.get(attribute)
        if value is None:
            return default
        if (text := value.strip()) not in ("true", "false", "1", "0"):
            self.malformed(element, attribute, value, '"true" or "false"')
            return default
        return text in ("true", "1")

    def malformed(self, element: etree._Element, attribute: str, value: str, wanted: str) -> None:
        self.problem(
            element, f'attribute "{attribute}" of <{local_name(element)}> is "{value[:60]}"; it must be {wanted}'
        )


def whole(text: str, low: int, high: int) -> int | None:
    """Returns the integer from `low` to `high` that `text` contains, or None if it does not contain one."""
    text = text.strip()
    if not _INTEGER.fullmatch(text) or len(text) > 22 or not low <= int(text) <= high:
        return None
    return int(text)


def plain_number(text: str) -> float:
    """Returns the number that a person has written: as `float` reads it, but without underscores and foreign digits.

    Raises:
        ValueError: the text is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text} is not a number")
    return float(text)


def double(text: str) -> float | None:
    """Returns the number that `text` contains in the form of XML Schema (xs:double), or None if it is not one."""
    text = text.strip()
    return float(text.replace("INF", "inf")) if _DOUBLE.fullmatch(text) else None


def _between(low: int, high: int) -> str:
    return f"an integer from {low} to {high}"


def _order(form: Form) -> str:
    return ", ".join(etree.QName(tag).localname for tag in form.children)
