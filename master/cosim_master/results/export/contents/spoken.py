"""The texts of a run: STATUSTEXT of all nodes, and the findings of the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.messages import STATUSTEXT, STATUSTEXT_TEXT
from cosim.verdict import Role
from cosim_master.results.export.contents.packet_log import packets_of
from cosim_master.results.reading.roles import players, read_manifest
from cosim_master.results.recording.packet_log import EPOCH

__all__ = ["Spoken", "spoken"]

_SEVERITY = {"failure": 3, "warning": 4, "note": 6}


@dataclass(frozen=True, slots=True)
class Spoken:
    """A text.

    Attributes:
        stamp: ns since 1970, on the clock of the run's .tlog files.
        severity: MAV_SEVERITY: 0 emergency to 3 error, 4 warning, 5 notice, 6 information, 7 debug.
        who: the speaker, or the subjects of a finding.
        text: the text.
    """

    stamp: int
    severity: int
    who: str
    text: str


def spoken(run: Path) -> list[Spoken]:
    """Returns the texts of a run in the order of their times.

    Raises:
        CosimError: the manifest is not that of a complete run.
    """
    manifest = read_manifest(run)
    found = list(_status_texts(run, manifest))
    for finding in (manifest.get("verdict") or {}).get("findings", ()):
        stamp = EPOCH * 1000 + round(1e9 * (finding.get("time") or 0.0))
        severity = _SEVERITY.get(finding.get("severity", ""), 6)
        found.append(Spoken(stamp, severity, ", ".join(finding.get("who", ())), str(finding.get("text"))))
    return sorted(found, key=lambda one: one.stamp)


def _status_texts(run: Path, manifest: Mapping[str, Any]) -> Iterator[Spoken]:
    log = run / "packets.tlog"
    if not log.is_file():
        return
    names: dict[int, str] = {}
    for name, player in players(run, manifest).items():
        number = player.parameters.get(player.named(Role.SYSTEM_ID))
        if isinstance(number, int):
            names.setdefault(number, name.rpartition(".")[0] or name)
    for packet in packets_of(log.read_bytes()):
        if packet.message == STATUSTEXT:
            payload = packet.payload.ljust(STATUSTEXT_TEXT + 50, b"\0")
            text = payload[STATUSTEXT_TEXT : STATUSTEXT_TEXT + 50].split(b"\0")[0].decode("utf-8", "replace")
            system = packet.address[0]
            yield Spoken(packet.stamp * 1000, payload[0], names.get(system, f"system {system}"), text)
