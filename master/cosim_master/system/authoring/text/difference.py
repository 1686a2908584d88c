"""The differences in meaning between two descriptions."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from lxml import etree

from cosim_master.system.structure import Annotation

__all__ = ["difference"]

_PLACES = ("where", "document", "content", "source")
"""Fields with the place from which an item was read, or where it is."""


def difference(wanted: Any, found: Any, what: str) -> str | None:
    """Returns the place where two descriptions differ, ignoring their files and lines; None if they are equal.

    Args:
        what: the kind of items, for the result.
    """
    if is_dataclass(wanted) and type(wanted) is type(found):
        for one in fields(wanted):
            name = getattr(wanted, "name", "")
            inner = f'{one.name} of {type(wanted).__name__} "{name}"' if name else f"{one.name} of {what}"
            if one.name in _PLACES:
                continue
            if isinstance(wanted, Annotation) and isinstance(found, Annotation) and one.name == "element":
                if _canonical(wanted.element) == _canonical(found.element):
                    continue
                return inner
            if (text := difference(getattr(wanted, one.name), getattr(found, one.name), inner)) is not None:
                return text
        return None
    if isinstance(wanted, tuple) and isinstance(found, tuple) and len(wanted) == len(found):
        return next((t for a, b in zip(wanted, found, strict=True) if (t := difference(a, b, what)) is not None), None)
    return None if wanted == found else what


def _canonical(element: etree._Element) -> bytes:
    """Returns an element without the whitespace between its children."""
    text = etree.tostring(element, with_tail=False)
    bare = etree.fromstring(text, etree.XMLParser(remove_blank_text=True, no_network=True, resolve_entities=False))
    return etree.tostring(bare, method="c14n", exclusive=True)
