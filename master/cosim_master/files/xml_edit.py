"""XML documents as bytes with positions: change one attribute or element and leave every other byte as it is.

This module does not depend on SSP. It writes ASCII with character references, which is valid in every encoding that
includes ASCII. Documents in other encodings (UTF-16) are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from cosim_master.diagnostics.limitations import ENCODING

__all__ = ["Document", "Edit", "Node", "applied", "tag_text"]

_NAME = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_SPACE_BEFORE = re.compile(rb"[ \t\r\n]*\Z")


@dataclass(frozen=True, slots=True)
class Edit:
    """A replacement of the bytes from start to stop."""

    start: int
    stop: int
    text: bytes


@dataclass(slots=True, eq=False)
class Node:
    """An element.

    Attributes:
        tag: "{namespace}name".
        scope: namespaces by prefix; "" is the default one.
        start, head: positions of the start tag: its "<", and the byte after its ">".
        foot, end: positions of the end tag: its "</", and the byte after its ">"; both are `head` for <a/>.
    """

    tag: str
    scope: Mapping[str, str]
    start: int
    head: int
    foot: int = 0
    end: int = 0
    children: list[Node] = field(default_factory=list)

    def all(self, tag: str) -> list[Node]:
        """Returns all children with a tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Node | None:
        """Returns the first child with a tag."""
        return next(iter(self.all(tag)), None)


class Document:
    """A document and its elements.

    Raises:
        ValueError: the document is not well-formed, or its encoding does not include ASCII.
    """

    def __init__(self, data: bytes) -> None:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
            raise ValueError(ENCODING.text())
        self.data = data
        self._open: list[Node] = []
        self._root: Node | None = None
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._started
        self._parser.EndElementHandler = self._ended
        try:
            self._parser.Parse(data, True)
        except (expat.ExpatError, LookupError) as error:
            raise ValueError(f"cannot be changed: {error}") from error
        assert self._root is not None
        self.root: Node = self._root

    def _started(self, name: str, attributes: dict[str, str]) -> None:
        scope = dict(self._open[-1].scope) if self._open else {}
        for key, value in attributes.items():
            if key == "xmlns" or key.startswith("xmlns:"):
                scope[key.partition(":")[2]] = value
        prefix, colon, local = name.rpartition(":")
        space = scope.get(prefix, "") if colon else scope.get("", "")
        at = self._parser.CurrentByteIndex
        node = Node(f"{{{space}}}{local}" if space else local, scope, at, self._tag_end(at))
        if self._open:
            self._open[-1].children.append(node)
        else:
            self._root = node
        self._open.append(node)

    def _ended(self, _: str) -> None:
        node = self._open.pop()
        at = self._parser.CurrentByteIndex
        closed = self.data[node.head - 2 : node.head] == b"/>"
        node.foot = node.head if closed else at
        node.end = node.head if closed else self.data.index(b">", at) + 1

    def _tag_end(self, start: int) -> int:
        tag = _NAME.match(self.data, start)
        at = start if tag is None else tag.end()
        while (match := _ATTRIBUTE.match(self.data, at)) is not None:
            at = match.end()
        return self.data.index(b">", at) + 1

    def _attributes(self, node: Node) -> Iterator[re.Match[bytes]]:
        tag = _NAME.match(self.data, node.start)
        at = node.start if tag is None else tag.end()
        while (match := _ATTRIBUTE.match(self.data, at)) is not None:
            yield match
            at = match.end()

    def attribute(self, node: Node, name: str, value: str | None) -> list[Edit]:
        """Returns the edit that sets an attribute of an element, or removes it (None)."""
        end = node.start
        for match in self._attributes(node):
            end = match.end()
            if match.group(1) == name.encode():
                if value is None:
                    return [Edit(match.start(), match.end(), b"")]
                span = match.span(2 if match.group(2) is not None else 3)
                return [Edit(*span, _quoted(value)[1:-1])]
        if value is None:
            return []
        if end == node.start and (tag := _NAME.match(self.data, node.start)) is not None:
            end = tag.end()
        return [Edit(end, end, b" " + name.encode() + b"=" + _quoted(value))]

    def removed(self, node: Node) -> list[Edit]:
        """Returns the edit that removes an element and the whitespace before it."""
        space = _SPACE_BEFORE.search(self.data, 0, node.start)
        return [Edit(node.start if space is None else space.start(), node.end, b"")]

    def indent(self, node: Node) -> str:
        """Returns the line break and whitespace before an element; empty if the element does not begin a line."""
        space = _SPACE_BEFORE.search(self.data, 0, node.start)
        text = b"" if space is None else space.group()
        return "\n" + text.rpartition(b"\n")[2].decode() if b"\n" in text else ""

    def inserted(self, parent: Node, texts: Sequence[str], after: Node | None) -> list[Edit]:
        """Returns the edit that inserts elements into `parent`, after one of its children or before all of them."""
        indent = self.indent(after or (parent.children[0] if parent.children else parent))
        if after is None and not parent.children and indent:
            indent += "  "
        made = "".join(indent + text.replace("\n", indent or "\n") for text in texts).encode(
            "ascii", "xmlcharrefreplace"
        )
        if after is not None:
            return [Edit(after.end, after.end, made)]
        if self.data[parent.head - 2 : parent.head] != b"/>":
            blank = not parent.children and not self.data[parent.head : parent.foot].strip()
            if blank:
                return [Edit(parent.head, parent.foot, made + self.indent(parent).encode())]
            return [Edit(parent.head, parent.head, made)]
        name = _NAME.match(self.data, parent.start)
        close = b"</" + (b"" if name is None else name.group()[1:]) + b">"
        return [Edit(parent.head - 2, parent.head, b">" + made + self.indent(parent).encode() + close)]


def _quoted(value: str) -> bytes:
    return quoteattr(value, {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}).encode("ascii", "xmlcharrefreplace")


def tag_text(
    scope: Mapping[str, str], tag: str, attributes: Mapping[str, str | None], children: Sequence[str] = ()
) -> str:
    """Returns an element as text; its namespace is declared on it if the namespace has no prefix in `scope`."""
    space, _, local = tag[1:].partition("}")
    prefixes = [prefix for prefix, uri in scope.items() if uri == space]
    name = f"{prefixes[0]}:{local}" if prefixes and prefixes[0] else local
    given = {key: value for key, value in attributes.items() if value is not None}
    if not prefixes:
        given = {"xmlns": space, **given}
    head = name + "".join(f" {key}={_quoted(value).decode()}" for key, value in given.items())
    if not children:
        return f"<{head}/>"
    inner = "\n".join(children).replace("\n", "\n  ")
    return f"<{head}>\n  {inner}\n</{name}>"


def applied(data: bytes, edits: Sequence[Edit]) -> bytes:
    """Returns the bytes after all edits; edits at the same place are applied in their order.

    Raises:
        ValueError: two edits overlap.
    """
    pieces, at = [], 0
    for edit in sorted(edits, key=lambda one: (one.start, one.stop)):
        if edit.start < at:
            raise ValueError("two changes are at the same place; make them one after the other")
        pieces += [data[at : edit.start], edit.text]
        at = edit.stop
    return b"".join([*pieces, data[at:]])
