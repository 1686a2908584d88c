"""The judgement of a run, from predictions, observations, and the counters of radio and gateways."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from cosim_master.system.settings.network import Network
from cosim_master.verdict.findings import Finding, Judgement
from cosim_master.verdict.monitors import reporting as of_monitors
from cosim_master.verdict.monitors.monitoring import Monitoring
from cosim_master.verdict.prior import DOUBLE_ID
from cosim_master.verdict.reporting import findings, nearest
from cosim_master.verdict.watching.watch import Watch

__all__ = ["judgement"]


def judgement(
    before: Judgement,
    watch: Watch,
    network: Network,
    packets: Mapping[str, int],
    crossed: Mapping[str, Mapping[str, int | str]],
    monitoring: Monitoring | None = None,
) -> Judgement:
    """Returns the judgement of a run that has ended.

    Args:
        before: the findings known before the run.
        watch: the observer, already closed.
        packets: see `Execution.packet_counts`.
        crossed: see `Gateways.counts`.
        monitoring: the observer of the system's monitors, already closed; None: it has none.
    """
    quiet = {gateway.name for gateway in network.gateways if gateway.quiet}
    crossed = {name: counts for name, counts in crossed.items() if name not in quiet}
    on_air = [gateway.name for gateway in network.gateways if gateway.wired is None]
    known = [one for one in before.findings if not (watch.hears_by_place and one.kind == DOUBLE_ID)]
    found = [*known, *findings(watch), *_of_radio(packets), *_of_gateways(crossed, on_air)]
    if monitoring is None:
        return Judgement.of(found, watch.begin, watch.end, nearest(watch))
    found += of_monitors.findings(monitoring)
    return Judgement.of(found, watch.begin, watch.end, nearest(watch), of_monitors.in_manifest(monitoring))


def _of_radio(packets: Mapping[str, int]) -> Iterator[Finding]:
    """Returns the findings from the counters of the radio."""
    sent, delivered, on_the_way = (packets.get(what, 0) for what in ("sent", "delivered", "in flight"))
    if sent and not delivered and not on_the_way:
        causes = ", ".join(f"{n} {cause}" for cause, n in packets.items() if cause.startswith("lost: ") and n)
        text = f"none of the {sent} packets sent by radio has reached a node ({causes})"
        yield Finding("no radio", "warning", (), text, numbers={"sent": sent, "delivered": delivered})


def _of_gateways(counts: Mapping[str, Mapping[str, int | str]], on_air: Sequence[str]) -> Iterator[Finding]:
    """Yields findings about gateways that carried no packets.

    For wired gateways, a finding requires that none of them carried packets, since a program may use a single vehicle.
    """
    silent = [name for name, crossed in counts.items() if not crossed.get("sent") and not crossed.get("received")]
    wired = [name for name in counts if name not in on_air]
    if not all(name in silent for name in wired):
        silent = [name for name in silent if name in on_air]
    for name in silent:
        text = f"nothing has crossed {name} ({counts[name]['address']}): has a program connected to it?"
        yield Finding("silent gateway", "warning", (name,), text)
