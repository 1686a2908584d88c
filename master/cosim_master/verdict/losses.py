"""Packets lost by radio, in words: nothing arrives, a link is silent, a medium is overloaded, and the worst link.

Losses by distance alone (out of range, weak signals, no route) are what a radio with a range is for: they make a
finding only of links that the system lists one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from cosim_master.system.settings.network import Network
from cosim_master.verdict.findings import Finding, Number

__all__ = ["Links", "of_radio"]

Array: TypeAlias = np.ndarray[Any, Any]

_ENOUGH = 20
"""Packets of a link, below which its losses say nothing."""
_SHARE = 0.1
"""Share of a link's packets whose loss is a finding."""
_NAMED = 3
"""Links that a text names."""
_BY_DISTANCE = ("range", "signal", "no route")
_BY_LOAD = ("queue", "collision")


class Links(Protocol):
    """The links on which packets were sent; arrays have an element per link, nodes are numbers of `nodes`."""

    @property
    def nodes(self) -> tuple[str, ...]: ...
    @property
    def source(self) -> Array: ...
    @property
    def target(self) -> Array: ...
    @property
    def sent(self) -> Array: ...
    @property
    def lost(self) -> Array: ...
    @property
    def causes(self) -> Mapping[str, Array]:
        """Packets lost, by cause."""


def of_radio(
    packets: Mapping[str, int], links: Links | None, network: Network, known: Sequence[Finding]
) -> Iterator[Finding]:
    """Yields the findings about packets by radio.

    Args:
        packets: see `Execution.packet_counts`.
        links: packets by link and cause; None: they are not recorded, and all links are judged together.
        network: settings of the radio.
        known: findings from before the run; links that these explain are left out.
    """
    sent, delivered, on_the_way = (packets.get(what, 0) for what in ("sent", "delivered", "in flight"))
    lost = packets.get("lost", 0)
    if sent >= (_ENOUGH if on_the_way and not lost else 1) and not delivered:
        told = ", ".join(filter(None, (_totals(packets), f"{on_the_way} still in flight" if on_the_way else "")))
        text = f"none of the {sent} packets sent by radio has reached a node ({told})"
        yield Finding("no radio", "warning", (), text, numbers={"sent": sent, "delivered": delivered})
    elif links is None:
        yield from _of_all(packets)
    elif len(links.sent):
        yield from _of_links(links, network, known, packets)


def _totals(packets: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {cause}" for cause, n in packets.items() if cause.startswith("lost: ") and n)


def _of_all(packets: Mapping[str, int]) -> Iterator[Finding]:
    sent = packets.get("sent", 0)
    load = sum(packets.get(f"lost: {cause}", 0) for cause in _BY_LOAD)
    distance = sum(packets.get(f"lost: {cause}", 0) for cause in _BY_DISTANCE)
    share = f"{packets.get('lost', 0)} of {sent} packets by radio were lost ({_totals(packets)})"
    numbers: dict[str, Number] = {name: n for name, n in packets.items() if name in ("sent", "lost") or ": " in name}
    if sent >= _ENOUGH and load >= _SHARE * sent:
        text = f"the radio is overloaded: {share}; send less, or raise the rate of the medium"
        yield Finding("overloaded radio", "warning", (), text, numbers=numbers)
    elif sent >= _ENOUGH and packets["lost"] - distance >= _SHARE * sent:
        yield Finding("packets lost", "note", (), share, numbers=numbers)


def _of_links(
    links: Links, network: Network, known: Sequence[Finding], packets: Mapping[str, int]
) -> Iterator[Finding]:
    cut = [links.nodes.index(who) for one in known if one.kind == "cut off" for who in one.who if who in links.nodes]
    counted = (links.sent >= _ENOUGH) & ~np.isin(links.source, cut) & ~np.isin(links.target, cut)
    lost = links.lost.copy()
    if network.topology != "listed":
        lost -= _by(links, _BY_DISTANCE)
    silent = counted & (lost > 0) & (links.lost == links.sent)
    overloaded = counted & ~silent & (_by(links, _BY_LOAD) >= _SHARE * links.sent)
    noted = counted & ~silent & ~overloaded & (lost >= _SHARE * links.sent)
    if silent.any():
        text = "nothing has arrived on {}: check outages, partitions, jamming, loss and range there"
        yield _finding("silent link", "warning", text, links, silent, links.lost)
    if overloaded.any():
        load = _by(links, _BY_LOAD)
        text = "the radio is overloaded on {}: send less, or raise the rate of the medium"
        yield _finding("overloaded radio", "warning", text, links, overloaded, load)
    if noted.any():
        share = packets["lost"] / packets["sent"]
        text = f"{share:.0%} of all packets by radio were lost ({_totals(packets)}), most on {{}}"
        yield _finding("packets lost", "note", text, links, noted, lost)


def _by(links: Links, causes: Sequence[str]) -> Array:
    """Returns for each link the packets that were lost by these causes."""
    found = np.zeros(len(links.sent), np.int64)
    for cause in causes:
        found += links.causes.get(cause, 0)
    return found


def _finding(kind: str, severity: Any, text: str, links: Links, which: Array, lost: Array) -> Finding:
    """Returns a finding about some links, the one with the largest share of losses first."""
    worst = np.flatnonzero(which)
    worst = worst[np.lexsort((links.target[worst], links.source[worst], -lost[worst] / links.sent[worst]))]
    names = [f"{links.nodes[links.source[i]]} to {links.nodes[links.target[i]]}" for i in worst]
    parts = [f"{name} ({_lost(links, int(i))})" for name, i in zip(names[:_NAMED], worst, strict=False)]
    if len(worst) > _NAMED:
        parts.append(f"and {len(worst) - _NAMED} more")
    first = worst[0]
    numbers: dict[str, Number] = {"links": len(worst), "sent": int(links.sent[first]), "lost": int(links.lost[first])}
    numbers |= {f"lost: {cause}": int(n[first]) for cause, n in links.causes.items() if n[first]}
    who = (links.nodes[links.source[first]], links.nodes[links.target[first]])
    return Finding(kind, severity, who, text.format(", ".join(parts)), numbers=numbers)


def _lost(links: Links, link: int) -> str:
    causes = ", ".join(f"{n[link]} {cause}" for cause, n in links.causes.items() if n[link])
    return f"{links.lost[link]} of {links.sent[link]} lost: {causes}"
