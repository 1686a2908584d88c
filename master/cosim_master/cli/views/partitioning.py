"""The cut of a system into parts, as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from cosim_master.execution.partitions.cut import Cut
    from cosim_master.execution.preparation.prepare import Prepared

__all__ = ["partition_document", "partition_tables"]

_SHOWN = 6


def partition_document(cut: Cut, ready: Prepared) -> dict[str, Any]:
    """Returns the JSON document of a cut; `bytes` are those of values per window, packets come on top."""
    from cosim_master.execution.partitions.cut import uses_positions
    from cosim_master.execution.partitions.hearing import carries_positions, reach_of
    from cosim_master.execution.partitions.nearest import counts_nearest
    from cosim_master.stepping.layout import make_layout

    layout = make_layout(ready.checked, ready.network, ready.recording.signals, ready.master)
    window, carried, reach = ready.clock.seconds(cut.window), carries_positions(ready.network), reach_of(ready.network)
    nearest = counts_nearest(ready.network)
    parts = []
    for part in range(cut.parts):
        instances = [i.name for i, p in zip(ready.checked.instances, cut.of_instance, strict=True) if p == part]
        nodes = [n.name for n, p in zip(ready.network.nodes, cut.of_node, strict=True) if p == part]
        reals, ints = cut.passed_on(part, layout, ready.network)
        apart = len(reals) - (3 * len(nodes) if carried or nearest else 0)
        passed = cut.window * (8 * apart + 4 * len(ints) + 8)
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
        "carried": carried,
        "nearest": ready.network.neighbours if nearest else None,
        "sides": nearest and ready.network.axis is not None,
        "reach_m": None if reach == math.inf else reach,
    }


def partition_tables(document: Mapping[str, Any]) -> Iterator[Table | str]:
    """Returns the cut as tables and lines."""
    table = Table(box=None, pad_edge=False)
    for name in ("part", "instances", "nodes", "values passed on per window"):
        table.add_column(name)
    for one in document["parts"]:
        nodes = one["nodes"]
        named = ", ".join(nodes[:_SHOWN]) + (f" and {len(nodes) - _SHOWN} more" if len(nodes) > _SHOWN else "")
        table.add_row(str(one["part"]), str(one["instances"]), Text(named), f"{one['bytes']} B")
    yield table
    ahead = document["lookahead_s"]
    limited = "nothing crosses" if ahead is None else f"{document['limit']} takes {ahead:g} s"
    hidden = ", hidden behind stepping" if document["hidden"] else ", waited for"
    yield (
        f"window: {document['window_s']:.9g} s ({limited}), {document['exchanges_per_s']:.6g} exchanges per simulated "
        f"second{hidden}"
    )
    yield f"cut: {_radio(document)}; {document['connections_cut']} delayed connections"


def _radio(document: Mapping[str, Any]) -> str:
    """Returns the packets and positions that cross, in words."""
    links, reach = document["links_cut"], document["reach_m"]
    if reach is not None:
        found = f"packets go to parts with nodes within {reach:.4g} m of their sender"
        found = found if links is None else f"{links} radio links; {found}"
    elif document["nearest"] is not None:
        each = " on each side" if document["sides"] else ""
        return f"packets and positions go to parts with nodes that may be among the {document['nearest']} nearest{each}"
    elif links is None:
        found = "any node may hear any other: all packets go to all parts"
    else:
        found = f"{links} radio links"
    if document["carried"]:
        return f"{found}, with its position"
    return f"{found}; positions of all nodes as well" if document["positions"] else found
