"""The references of a system's documents to other files: attributes, and the bytes of their values.

A new value of a reference replaces only these bytes.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit
from xml.parsers import expat
from xml.sax.saxutils import escape

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import ENCODING

__all__ = ["Reference", "references"]

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription "
_REFERRING = {_SSD + name for name in ("Component", "ParameterBinding", "ParameterMapping", "SignalDictionary")}
_NETWORK = "https://uav-cosim.org/ns/1 network"
_TAG = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")


def _refusal(shown: str, message: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(shown), message)])


@dataclass(frozen=True, slots=True)
class Reference:
    """An attribute of a document that leads to another file: a `source`, or a file of a network.

    Attributes:
        elements: names from the root system (excluded) to the component; empty for other references.
        start, stop: position of its value in the bytes of the file.
        target: absolute path of the referenced file; None if its value is not a relative path.
        fragment: the part after "#".
        type: type of a component, as written.
        network: the attribute of a network (`dialect`, `trace`, `channel`), whose value is a path and not a URI.
    """

    elements: tuple[str, ...]
    start: int
    stop: int
    target: Path | None
    fragment: str = ""
    type: str = ""
    network: str = ""

    def written(self, path: str) -> bytes:
        """Returns the attribute's value if the file is at `path`, relative to the document, with the same fragment."""
        posix = Path(path).as_posix()
        if self.network:
            return escape(posix, {'"': "&quot;", "'": "&apos;"}).encode("ascii", "xmlcharrefreplace")
        return (quote(posix) + (f"#{quote(self.fragment)}" if self.fragment else "")).encode("ascii")


def references(data: bytes, document: Path, shown: str) -> list[Reference]:
    """Returns every reference of a document to another file, in order."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
        raise _refusal(shown, ENCODING.text())
    found: list[Reference] = []
    names: list[str | None] = []
    parser = expat.ParserCreate(namespace_separator=" ")

    def started(tag: str, attributes: dict[str, str]) -> None:
        named = tag in (_SSD + "System", _SSD + "Component")
        names.append(attributes.get("name", "") if named else None)
        for name in ("dialect", "trace", "channel") if tag == _NETWORK else ():
            if attributes.get(name):
                start, stop = _span(data, parser.CurrentByteIndex, shown, name.encode())
                target = Path(os.path.normpath(document.parent / attributes[name]))
                found.append(Reference((), start, stop, target, network=name))
        uri = attributes.get("source")
        if uri is None or tag not in _REFERRING or attributes.get("sourceBase") == "component":
            return
        elements = tuple(name for name in names if name is not None)[1:] if named else ()
        start, stop = _span(data, parser.CurrentByteIndex, shown, b"source")
        fragment, kind = unquote(urlsplit(uri).fragment), attributes.get("type", "")
        found.append(Reference(elements, start, stop, _target(document, uri), fragment, kind))

    def ended(_: str) -> None:
        names.pop()

    parser.StartElementHandler = started
    parser.EndElementHandler = ended
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise _refusal(shown, f"cannot be changed: {error}") from error
    return found


def _target(document: Path, uri: str) -> Path | None:
    parts = urlsplit(uri)
    if parts.scheme or parts.netloc or not parts.path:
        return None
    return Path(os.path.normpath(document.parent / unquote(parts.path)))


def _span(data: bytes, index: int, shown: str, attribute: bytes) -> tuple[int, int]:
    """Returns the span of an attribute's value in the start tag that begins at `index`."""
    tag = _TAG.match(data, index)
    at = len(data) if tag is None else tag.end()
    while (match := _ATTRIBUTE.match(data, at)) is not None:
        if match.group(1) == attribute:
            return match.span(2 if match.group(2) is not None else 3)
        at = match.end()
    raise _refusal(shown, "has a start tag that cannot be changed; save it as UTF-8")
