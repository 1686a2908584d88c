"""The cut of a system into parts, as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from rich.table import Table

if TYPE_CHECKING:
    from cosim_master.execution.partitions.cut import Cut
    from cosim_master.execution.preparation.prepare import Prepared

__all__ = ["partition_document", "partition_tables"]

_SHOWN = 6


def partition_document(cut: Cut, ready: Prepared) -> dict[str, Any]:
    """Returns the JSON document of a cut; `bytes` are those of values per window, packets come on top."""
    from cosim_master.execution.partitions.cut import uses_positions
    from cosim_master.stepping.layout import make_layout

    layout = make_layout(ready.checked, ready.network, ready.recording.signals, ready.master)
    window = ready.clock.seconds(cut.window)
    parts = []
    for part in range(cut.parts):
        instances = [i.name for i, p in zip(ready.checked.instances, cut.of_instance, strict=True) if p == part]
        nodes = [n.name for n, p in zip(ready.network.nodes, cut.of_node, strict=True) if p == part]
        reals, ints = cut.passed_on(part, layout, ready.network)
        passed = cut.window * (8 * len(reals) + 4 * len(ints) + 8)
        parts.append({"part": part, "nodes": nodes, "instances": len(instances), "bytes": passed * (cut.parts - 1)})
    return {
        "parts": parts,
        "window_s": window,
        "hidden": cut.hidden,
        "lookahead_s": None if cut.lookahead == math.inf else cut.lookahead,
        "limit": cut.limit,
        "exchanges_per_s": 1.0 / window,
        "links_cut": cut.links,
        "connections_cut": cut.connections,
        "positions": uses_positions(ready.network),
    }


def partition_tables(document: Mapping[str, Any]) -> Iterator[Table | str]:
    """Returns the cut as tables and lines."""
    table = Table(box=None, pad_edge=False)
    for name in ("part", "instances", "nodes", "values passed on per window"):
        table.add_column(name)
    for one in document["parts"]:
        nodes = one["nodes"]
        named = ", ".join(nodes[:_SHOWN]) + (f" and {len(nodes) - _SHOWN} more" if len(nodes) > _SHOWN else "")
        table.add_row(str(one["part"]), str(one["instances"]), named, f"{one['bytes']} B")
    yield table
    ahead = document["lookahead_s"]
    limited = "nothing crosses" if ahead is None else f"{document['limit']} takes {ahead:g} s"
    hidden = ", hidden behind stepping" if document["hidden"] else ", waited for"
    yield (
        f"window: {document['window_s']:.9g} s ({limited}), {document['exchanges_per_s']:.6g} exchanges per simulated "
        f"second{hidden}"
    )
    links = document["links_cut"]
    radio = "any node may hear any other: all packets go to all parts" if links is None else f"{links} radio links"
    positions = "; positions of all nodes as well" if document["positions"] else ""
    yield f"cut: {radio}{positions}; {document['connections_cut']} delayed connections"
