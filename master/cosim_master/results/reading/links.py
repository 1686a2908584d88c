"""The links of a recording: packets, losses by cause and delays from each sender to each node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cosim_master.results.reading.read import packets
from cosim_master.results.storage.arrays import numbers
from cosim_master.system.flatten.flat import natural

__all__ = ["Links", "nodes_of", "read_links", "statistics"]

Array: TypeAlias = np.ndarray[Any, Any]

_LISTED = 100
"""Links in the manifest; a broadcast among 1,000 drones has a million."""


@dataclass(frozen=True, slots=True)
class Links:
    """All links on which packets were sent by radio.

    Attributes:
        nodes: names in natural order.
        source, target: (n,) numbers of nodes, one pair for each link.
        sent, lost: (n,) numbers of packets.
        mean: (n,) mean delay of the packets that arrived, s; NaN if none did.
        delays: delay of each packet that arrived, s.
        causes: (n,) numbers of packets lost for each cause that occurred ("channel", "range"), in alphabetical order.
    """

    nodes: tuple[str, ...]
    source: Array
    target: Array
    sent: Array
    lost: Array
    mean: Array
    delays: Array
    causes: Mapping[str, Array] = field(default_factory=dict)

    def worst(self) -> Array:
        """Returns the numbers of all links, those with the largest share of losses first."""
        return np.lexsort((self.target, self.source, -self.lost / self.sent))

    def causes_of(self, link: int) -> dict[str, int]:
        """Returns the packets that a link lost, by cause."""
        return {cause: int(counts[link]) for cause, counts in self.causes.items() if counts[link]}


def statistics(run: Path) -> dict[str, Any]:
    """Returns the links of a run as JSON: their number, and packets and delay [s] of the 100 with most losses.

    A packet that is in flight at the end of the run counts as delivered.

    Raises:
        CosimError: the run has no record of packets, or an incomplete one.
    """
    return in_manifest(read_links(run))


def in_manifest(links: Links) -> dict[str, Any]:
    """Returns links as `statistics`."""
    listed = [
        {
            "from": links.nodes[links.source[i]],
            "to": links.nodes[links.target[i]],
            "sent": int(links.sent[i]),
            "delivered": int(links.sent[i] - links.lost[i]),
            "lost": int(links.lost[i]),
            "causes": links.causes_of(i),
            "delay": None if np.isnan(links.mean[i]) else float(links.mean[i]),
        }
        for i in links.worst()[:_LISTED]
    ]
    return {"count": len(links.sent), "worst": listed}


def read_links(run: Path) -> Links:
    """Returns the links of a run.

    Raises:
        CosimError: the run has no record of packets, or an incomplete one.
    """
    table = packets(run, ["sent", "arrival", "source", "target", "outcome"])
    codes, columns = {}, {}
    for name in ("source", "target", "outcome"):
        coded = table[name].combine_chunks().dictionary_encode()
        codes[name], columns[name] = coded.dictionary.to_pylist(), numbers(coded.indices, np.int32)
    node_of = nodes_of(codes["source"], codes["target"])
    names = sorted({*node_of.values(), *(target for target in codes["target"] if target)}, key=natural)
    number = {name: i for i, name in enumerate(names)}
    of_source = np.array([number[node_of[source]] for source in codes["source"]], np.int64)
    of_target = np.array([number.get(target, -1) for target in codes["target"]], np.int64)
    radio = np.array([outcome == "radio" for outcome in codes["outcome"]], bool)
    gone = np.array([outcome.startswith("lost") for outcome in codes["outcome"]], bool)
    if not len(columns["source"]):
        nothing = np.empty(0, np.int64)
        return Links(tuple(names), nothing, nothing, nothing, nothing, np.empty(0), np.empty(0))
    source, target = of_source[columns["source"]], of_target[columns["target"]]
    arrived, lost = radio[columns["outcome"]] & (target >= 0), gone[columns["outcome"]] & (target >= 0)
    on_air = arrived | lost
    keys, link = np.unique(source[on_air] * len(names) + target[on_air], return_inverse=True)
    cause = columns["outcome"][on_air]
    causes = {
        outcome.removeprefix("lost: "): np.bincount(link[cause == code], minlength=len(keys))
        for code, outcome in sorted(enumerate(codes["outcome"]), key=lambda one: one[1])
        if gone[code] and (cause == code).any()
    }
    delay = (numbers(table["arrival"], np.float64) - numbers(table["sent"], np.float64))[on_air]
    here = arrived[on_air]
    count = np.bincount(link, weights=here, minlength=len(keys))
    with np.errstate(invalid="ignore"):
        mean = np.bincount(link, weights=np.where(here, delay, 0.0), minlength=len(keys)) / np.where(
            count, count, np.nan
        )
    return Links(
        tuple(names),
        keys // len(names),
        keys % len(names),
        np.bincount(link, minlength=len(keys)),
        np.bincount(link, weights=lost[on_air], minlength=len(keys)).astype(np.int64),
        mean,
        delay[here],
        causes,
    )


def nodes_of(sources: Sequence[str], targets: Sequence[str]) -> dict[str, str]:
    """Returns the node of each sender: the node whose name the sender's name begins with; a gateway is its own node."""
    known = {*targets}
    found = {}
    for source in sources:
        at = source
        while at and at not in known:
            at = at.rpartition(".")[0]
        found[source] = at or source
    return found
