"""Validates SSP files against the official XML schemas of SSP 1.0 and 2.0.1, with line numbers.

The schemas are data files of the package pyssp-standard (which is not imported); nothing is downloaded. Problems found
by our own grammar are reported first; the schemas add the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import distribution
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote, urlsplit

from lxml import etree

from cosim_master.diagnostics.errors import Problem, Where

__all__ = ["schema_folder", "validate"]

_NAMESPACES = {
    "Description": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "Common": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ParameterValues": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ParameterMapping": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "SignalDictionary": "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary",
}
_XS = "{http://www.w3.org/2001/XMLSchema}"
_SHOWN = 20


def schema_folder(version: int) -> Path:
    """Returns the folder with the schemas of SSP 1.0 or 2.0."""
    below = "pyssp_standard/resources" + ("/ssp2" if version >= 2 else "")
    return Path(str(distribution("pyssp-standard").locate_file(below)))


@lru_cache(maxsize=2)
def _schema(version: int) -> etree.XMLSchema:
    """Returns all schemas of a version as one, so that parameter sets and mappings in an .ssd are also validated."""
    folder = schema_folder(version)
    imports = "".join(
        f'<xs:import namespace="{namespace}" schemaLocation="{(folder / f"SystemStructure{name}.xsd").as_uri()}"/>'
        for name, namespace in _NAMESPACES.items()
    )
    text = f'<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">{imports}</xs:schema>'
    parser = etree.XMLParser(no_network=True)
    parser.resolvers.add(_Released())
    return etree.XMLSchema(etree.fromstring(text, parser))


class _Released(etree.Resolver):
    """Converts the installed schemas of SSP 2.0 to SSP 2.0.1, in which values of enumeration items have 64 bits."""

    def resolve(self, url: str, public: str | None, context: Any) -> Any:  # type: ignore[override]  # noqa: ARG002
        if not url.endswith("/ssp2/SystemStructureCommon.xsd"):
            return None
        schema = etree.parse(unquote(urlsplit(url).path), etree.XMLParser(no_network=True))
        item = f"{_XS}complexType[@name='TEnumeration']//{_XS}attribute[@name='value']"
        for attribute in schema.iterfind(item):
            attribute.set("type", "xs:long")
        return self.resolve_string(etree.tostring(schema), context, base_url=url)


def validate(root: etree._Element, version: int, shown: str, known: Iterable[Problem]) -> list[Problem]:
    """Returns the schema's errors in a document, except on lines with an already known problem.

    Args:
        root: the root element of the document.
        version: the version of the schema, 1 or 2.
        shown: the document's name.
        known: problems found so far.
    """
    schema = _schema(version)
    if schema.validate(root):
        return []
    lines = {problem.where.line for problem in known if problem.where.path == shown}
    # libxml2 reports several errors for the contents of a refused element; one message per line suffices.
    found: dict[int, Problem] = {}
    for entry in cast("Iterable[Any]", schema.error_log):
        if entry.line not in lines:
            found.setdefault(
                entry.line, Problem(Where(shown, entry.line), f"against the schema: {_plain(entry.message)}")
            )
    return list(found.values())[:_SHOWN]


def _plain(message: str) -> str:
    """Returns a message of libxml2 without the namespaces, which make it unreadable."""
    return re.sub(r"\{http://ssp-standard[.]org/[^}]*\}", "", message)
