"""Findings about packets lost by radio: silent, overloaded and lossy links, and nothing where all is well."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim_master.results.reading.links import Links
from cosim_master.system.settings.network import Network
from cosim_master.verdict.findings import Finding
from cosim_master.verdict.losses import of_radio


def links(*rows: tuple[str, str, int, dict[str, int]]) -> Links:
    """Links of (from, to, packets sent, packets lost by cause)."""
    nodes = tuple(sorted({name for row in rows for name in row[:2]}))
    causes = {
        cause: np.array([row[3].get(cause, 0) for row in rows]) for cause in sorted({c for r in rows for c in r[3]})
    }
    return Links(
        nodes,
        np.array([nodes.index(row[0]) for row in rows]),
        np.array([nodes.index(row[1]) for row in rows]),
        np.array([row[2] for row in rows]),
        np.array([sum(row[3].values()) for row in rows]),
        np.zeros(len(rows)),
        np.empty(0),
        causes,
    )


def found(some: Links | None, network: Network | None = None, *known: Finding, **lost: int) -> list[Finding]:
    counts = {"sent": 1000, "delivered": 1000 - sum(lost.values()), "lost": sum(lost.values()), "in flight": 0}
    counts |= {f"lost: {cause}": n for cause, n in lost.items()}
    return list(of_radio(counts, some, network or Network(), known))


def told(*given: Any, **lost: int) -> dict[str, str]:
    return {one.kind: one.text for one in found(*given, **lost)}


def test_a_radio_that_loses_little_says_nothing() -> None:
    few = ("a", "b", 19, {"channel": 19})
    assert told(links(("b", "a", 100, {"channel": 9}), few), channel=9) == {}
    assert told(links(("a", "b", 100, {}), ("b", "a", 100, {}))) == {}
    assert told(None, channel=99) == {}
    assert told(links()) == {}


def test_a_lossy_link_is_a_note_with_its_causes() -> None:
    some = links(("a", "b", 100, {"channel": 10, "burst": 2}), ("b", "a", 40, {"channel": 20}), ("c", "a", 40, {}))
    (one,) = found(some, channel=30, burst=2)
    assert (one.kind, one.severity, one.who, one.time) == ("packets lost", "note", ("b", "a"), None)
    assert one.text == (
        "3% of all packets by radio were lost (30 lost: channel, 2 lost: burst), most on b to a (20 of 40 lost: 20 "
        "channel), a to b (12 of 100 lost: 2 burst, 10 channel)"
    )
    assert one.numbers == {"links": 2, "sent": 40, "lost": 20, "lost: channel": 20}


def test_silent_and_overloaded_links_are_warnings() -> None:
    some = links(
        *(("a", f"n{i}", 30, {"jammed": 30}) for i in range(5)),
        ("b", "c", 100, {"queue": 30, "channel": 40}),
        ("c", "b", 100, {"collision": 10}),
    )
    silent, overloaded = found(some, jammed=150, queue=30, channel=40, collision=10)
    assert (silent.kind, silent.severity, silent.numbers["links"]) == ("silent link", "warning", 5)
    assert silent.text == (
        "nothing has arrived on a to n0 (30 of 30 lost: 30 jammed), a to n1 (30 of 30 lost: 30 jammed), a to n2 (30 of "
        "30 lost: 30 jammed), and 2 more: check outages, partitions, jamming, loss and range there"
    )
    assert (overloaded.kind, overloaded.severity, overloaded.who) == ("overloaded radio", "warning", ("b", "c"))
    assert "b to c (70 of 100 lost: 40 channel, 30 queue), c to b (10 of 100 lost: 10 collision)" in overloaded.text


@pytest.mark.parametrize("cause", ["range", "signal", "no route"])
def test_losses_by_distance_are_told_of_listed_links_only(cause: str) -> None:
    some = links(("a", "b", 100, {cause: 100}), ("b", "a", 100, {cause: 50, "channel": 5}))
    assert told(some, Network(topology="broadcast")) == {}
    listed = told(some, Network(topology="listed"), **{cause: 150, "channel": 5})
    assert listed.keys() == {"silent link", "packets lost"}
    assert f"a to b (100 of 100 lost: 100 {cause})" in listed["silent link"]


def test_nodes_that_are_known_to_be_cut_off_are_not_told_again() -> None:
    some = links(("a", "b", 100, {"outage": 100}), ("b", "a", 100, {"outage": 100}), ("c", "b", 100, {}))
    assert told(some, None, Finding("cut off", "warning", ("a",), ""), outage=200) == {}
    assert told(some, outage=200).keys() == {"silent link"}


def test_without_a_record_of_packets_all_links_are_judged_together() -> None:
    assert told(None, queue=100, channel=5) == {
        "overloaded radio": "the radio is overloaded: 105 of 1000 packets by radio were lost (100 lost: queue, 5 lost: "
        "channel); send less, or raise the rate of the medium"
    }
    assert told(None, channel=100) == {"packets lost": "100 of 1000 packets by radio were lost (100 lost: channel)"}
    assert told(None, range=600) == {}
    assert told(None, channel=1000).keys() == {"no radio"}


def test_packets_that_are_all_in_flight_have_not_arrived() -> None:
    """A latency of 20 ms that is written as 20 s; a few packets may be on the way at the end of a short run."""

    def found(sent: int) -> list[tuple[str, str]]:
        counts = {"sent": sent, "delivered": 0, "lost": 0, "in flight": sent}
        return [(one.kind, one.text) for one in of_radio(counts, None, Network(), ())]

    text = "none of the 1184 packets sent by radio has reached a node (1184 still in flight)"
    assert found(1184) == [("no radio", text)]
    assert found(5) == []
