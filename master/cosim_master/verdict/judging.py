"""The judgement of a run, at its end or meanwhile, from predictions, observations, and counters of the network."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from cosim_master.stepping.observation import Progress, Seen
from cosim_master.system.settings.network import Network
from cosim_master.verdict.findings import Finding, Judgement
from cosim_master.verdict.losses import Links, of_radio
from cosim_master.verdict.monitors import reporting as of_monitors
from cosim_master.verdict.monitors.monitoring import Monitoring
from cosim_master.verdict.prior import DOUBLE_ID
from cosim_master.verdict.reporting import findings, nearest
from cosim_master.verdict.watching.watch import Watch

__all__ = ["Interim", "judgement"]

_INTERVAL = 1.0
"""Wall-clock time between two judgements of a run that goes on, s."""


class Interim:
    """A `ProgressObserver` that judges a run while it goes on.

    It evaluates the looks so far earlier than the watch would; the verdict at the end is the same.

    Args:
        before: the findings known before the run.
        watch, monitoring: the observers of the run.
        network: nodes and gateways of the run.
        tell: called with each judgement that differs from the last one. It has only findings with a time.
    """

    every = 0

    def __init__(
        self,
        before: Judgement,
        watch: Watch,
        network: Network,
        monitoring: Monitoring | None,
        tell: Callable[[Judgement], None],
    ) -> None:
        self._before, self._watch, self._network = before, watch, network
        self._monitoring, self._tell = monitoring, tell
        self._judged_at = 0.0
        self._told: tuple[Finding, ...] | None = None

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...

    def progressed(self, progress: Progress) -> None:
        if progress.wall - self._judged_at < _INTERVAL:
            return
        self._judged_at = progress.wall
        self._watch.settle()
        if self._monitoring is not None:
            self._monitoring.settle()
        found = judgement(self._before, self._watch, self._network, progress.counts, {}, self._monitoring)
        told = tuple(one for one in found.findings if one.time is not None)
        if told != self._told:
            self._told = told
            self._tell(Judgement.of(told, found.begin, found.end, found.nearest))


def judgement(
    before: Judgement,
    watch: Watch,
    network: Network,
    packets: Mapping[str, int],
    crossed: Mapping[str, Mapping[str, int | str]],
    monitoring: Monitoring | None = None,
    links: Links | None = None,
) -> Judgement:
    """Returns the judgement of a run.

    Args:
        before: the findings known before the run.
        watch: the observer, already closed or settled.
        packets: see `Execution.packet_counts`.
        crossed: see `Gateways.counts`.
        monitoring: the observer of the system's monitors, already closed or settled; None: it has none.
        links: packets by link and cause; None: they were not recorded, or not yet.
    """
    quiet = {gateway.name for gateway in network.gateways if gateway.quiet}
    crossed = {name: counts for name, counts in crossed.items() if name not in quiet}
    on_air = [gateway.name for gateway in network.gateways if gateway.wired is None]
    known = [one for one in before.findings if not (watch.hears_by_place and one.kind == DOUBLE_ID)]
    found = [*known, *findings(watch), *of_radio(packets, links, network, known), *_of_gateways(crossed, on_air)]
    if monitoring is None:
        return Judgement.of(found, watch.begin, watch.end, nearest(watch))
    found += of_monitors.findings(monitoring)
    return Judgement.of(found, watch.begin, watch.end, nearest(watch), of_monitors.in_manifest(monitoring))


def _of_gateways(counts: Mapping[str, Mapping[str, int | str]], on_air: Sequence[str]) -> Iterator[Finding]:
    """Yields findings about gateways that carried no packets.

    For wired gateways, a finding requires that none of them carried packets, since a program may use a single vehicle.
    """
    silent = [name for name, crossed in counts.items() if _is_silent(crossed)]
    wired = [name for name in counts if name not in on_air]
    if not all(name in silent for name in wired):
        silent = [name for name in silent if name in on_air]
    for name in silent:
        crossed, where = counts[name], f"{name} ({counts[name]['address']})"
        text = f"nothing has crossed {where}: has a program connected to it?"
        if crossed.get("sent"):
            whole = f"{crossed['not taken']} of {_number(crossed, 'sent') + _number(crossed, 'not taken')} packets"
            text = f"{whole} were refused at {where}, and none came from it: does a program listen there?"
        yield Finding("silent gateway", "warning", (name,), text)


def _is_silent(crossed: Mapping[str, int | str]) -> bool:
    """Returns whether nothing came from a gateway and nothing went to it; UDP tells a refusal at the next packet."""
    return not crossed.get("received") and _number(crossed, "sent") <= 2 * _number(crossed, "not taken")


def _number(crossed: Mapping[str, int | str], what: str) -> int:
    return int(crossed.get(what, 0))
