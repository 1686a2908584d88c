"""The document of a run for the page, gathered in one pass over its signals.

The document is JSON for page/src/main.js. Long arrays are references to the block that accompanies it. It does not
contain markup.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.reading.roles import UNKNOWN, Part, parts, players, read_manifest
from cosim_master.results.storage.arrays import values_of
from cosim_master.view.block import Block, steps_between
from cosim_master.view.curves import Curves
from cosim_master.view.motion import Motion
from cosim_master.view.traffic import traffic

__all__ = ["replay", "told_verdict", "vehicle_of", "vehicles_by_name"]

_AT_ONCE = 256
"""Columns read at once: all columns of a thousand drones would not fit into memory."""
_PLOTTED = 10
"""Number of curves in each initial plot of the page."""
_WORDS = 9
"""Number of enumerations and Booleans of a vehicle that the page shows."""


def replay(run: Path) -> tuple[dict[str, Any], Block]:
    """Returns the document of a run and the block with its arrays.

    Raises:
        CosimError: the run is not complete, or it recorded nothing.
    """
    block = Block()
    manifest = read_manifest(run)
    known = players(run, manifest)
    with open_signals(run) as signals:
        fields = [field for field in signals.schema_arrow if field.name != "time"]
        time = values_of(signals.read(columns=["time"]).column(0))
        if len(time) == 0:
            raise CosimError(f"{run / 'signals.parquet'}: nothing to show: the run recorded no instant")
        units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in fields}
        motion = Motion(parts(units, known), known, units, time)
        curves = Curves(fields, block)
        for begin in range(0, len(fields), _AT_ONCE):
            group = fields[begin : begin + _AT_ONCE]
            table = signals.read(columns=[field.name for field in group])
            for field in group:
                column = table.column(field.name)
                curves.take(field, column)
                if not pa.types.is_string(field.type):
                    motion.take(field.name, values_of(column))
    start, end = float(time[0]), float(time[-1])
    quantum = 1e-6 * 10.0 ** max(0, int(np.ceil(np.log10(max(end - start, 1.0) / 4e3))))
    drones = motion.parts
    _belonging(curves.document, drones)
    packets = traffic(run, drones, block, start, quantum)
    vehicles = motion.document(block)
    for vehicle, words in zip(vehicles, _words(curves.document, len(drones)), strict=True):
        vehicle["words"] = words
    document = {
        "name": _text(manifest, "system", "name") or run.name,
        "start": start,
        "end": end,
        "quantum": quantum,
        "rows": block.add(steps_between(np.rint((time - start) / quantum).astype(np.int64)), "u4"),
        "motion": {"frames": block.add(motion.rows, "u4")},
        "vehicles": vehicles,
        "signals": curves.document,
        "steps": motion.steps(time),
        "plots": _first_plots(curves.document, drones, known),
        "traffic": packets,
        "network": _network(manifest),
        "packets": {name: manifest.get("packets", {}).get(name, 0) for name in ("sent", "delivered", "lost")},
        "verdict": told_verdict(manifest.get("verdict"), drones),
        "outcome": _outcome(manifest),
        "facts": _facts(run, manifest, curves, motion, packets, len(time)),
    }
    return document, block


def _text(manifest: Mapping[str, Any], *path: str) -> str:
    """Returns a value of the manifest as text; empty if it is missing."""
    at: Any = manifest
    for name in path:
        at = at.get(name) if isinstance(at, Mapping) else None
    return "" if at is None else str(at)


def _network(manifest: Mapping[str, Any]) -> dict[str, Any]:
    network = manifest.get("network", {})
    reach = network.get("range")
    told = {name: network.get(name) for name in ("topology", "latency", "jitter", "loss")}
    return told | {"range": reach if isinstance(reach, (int, float)) else None}


def vehicles_by_name(parts_: Sequence[Part]) -> dict[str, int]:
    """Returns the vehicle of each instance and of each system of a drone."""
    found: dict[str, int] = {}
    for i, part in enumerate(parts_):
        for name in (part.name, part.vehicle, part.agent):
            if name:
                found[name] = i
    return found


def vehicle_of(name: str, of: Mapping[str, int]) -> int:
    """Returns the vehicle of an instance or of one of its variables; -1 if it has none."""
    at = name
    while at:
        if at in of:
            return of[at]
        at = at.rpartition(".")[0]
    return -1


def _belonging(signals: Sequence[dict[str, Any]], drones: Sequence[Part]) -> None:
    of = vehicles_by_name(drones)
    for signal in signals:
        if (vehicle := vehicle_of(signal["name"], of)) >= 0:
            signal["vehicle"] = vehicle


def _words(signals: Sequence[Mapping[str, Any]], vehicles: int) -> list[list[int]]:
    """Returns the signals of each vehicle that have values in words: enumerations, texts and Booleans that change."""
    found: list[list[int]] = [[] for _ in range(vehicles)]
    for index, signal in enumerate(signals):
        said = "items" in signal or "boolean" in signal or "texts" in signal
        if said and "rows" in signal and (vehicle := signal.get("vehicle", -1)) >= 0 and len(found[vehicle]) < _WORDS:
            found[vehicle].append(index)
    return found


def _first_plots(
    signals: Sequence[Mapping[str, Any]], drones: Sequence[Part], known: Mapping[str, Any]
) -> list[list[int]]:
    """Returns the first plots: the axes along which vehicles move, widest range first; otherwise changing signals."""
    index = {signal["name"]: i for i, signal in enumerate(signals)}
    some = [
        drones[i] for i in np.unique(np.linspace(0, len(drones) - 1, min(len(drones), _PLOTTED)).round().astype(int))
    ]
    by_spread: list[tuple[float, int]] = []
    columns = {}
    for axis in (1, 2, 3):
        names = [f"{part.vehicle}.{known.get(part.vehicle, UNKNOWN).position}[{axis}]" for part in some]
        columns[axis] = [index[name] for name in names if name in index]
        by_spread.append((max((signals[i].get("spread", 0.0) for i in columns[axis]), default=0.0), axis))
    widest = max(by_spread)[0]
    plots = [columns[axis] for spread, axis in sorted(by_spread, reverse=True) if spread > 0.02 * widest]
    if plots:
        return plots
    changing = [i for i, signal in enumerate(signals) if "rows" in signal and "texts" not in signal]
    return [[i] for i in changing[:4]]


def told_verdict(verdict: Any, drones: Sequence[Part]) -> dict[str, Any] | None:
    """Returns a verdict as the page shows it, from that of a manifest; None if there is none."""
    if not isinstance(verdict, Mapping):
        return None
    of = vehicles_by_name(drones)
    findings = []
    for finding in verdict.get("findings", ()):
        vehicles = [vehicle for who in finding.get("who", ()) if (vehicle := vehicle_of(who, of)) >= 0]
        findings.append({**finding, "vehicle": vehicles[0] if vehicles else -1})
    told = {name: verdict.get(name, 0) for name in ("failures", "warnings", "notes")}
    return told | {"nearest": verdict.get("nearest"), "findings": findings}


def _outcome(manifest: Mapping[str, Any]) -> tuple[str, str]:
    """Returns the outcome in words, and its class in the style sheet."""
    verdict = manifest.get("verdict") or {}
    counted = [(verdict.get("failures", 0), "failure"), (verdict.get("warnings", 0), "warning")]
    said = [f"{n} {word}{'s' if n > 1 else ''}" for n, word in counted if n]
    outcome = str(manifest.get("outcome", ""))
    worst = next((word for n, word in counted if n), "good")
    return ", ".join([outcome, *said]), worst if outcome == "done" else "failure" if outcome == "failed" else "warning"


def _facts(
    run: Path, manifest: Mapping[str, Any], curves: Curves, motion: Motion, packets: Mapping[str, Any], rows: int
) -> list[tuple[str, str]]:
    """Returns a summary of the run in words, and the share of the recording that the page contains."""
    facts = [
        ("folder", str(run)),
        ("system", _text(manifest, "system", "path")),
        ("outcome", _text(manifest, "outcome")),
        ("error", _text(manifest, "error")),
        ("simulated", f"{manifest.get('simulated_s') or 0:.9g} s in {manifest.get('wall_s') or 0:.3g} s"),
        ("seed", _text(manifest, "seed")),
        ("base step", f"{_text(manifest, 'base_step')} s"),
        ("master", _text(manifest, "master", "algorithm")),
        ("instances", str(len(manifest.get("instances", ())))),
        ("FMUs", ", ".join(sorted(Path(path).name for path in manifest.get("fmus", ())))),
        *(
            (f"at {change['time']:g} s", f"{change['variable']} = {change['value']}")
            for change in manifest.get("changes", ())
        ),
        ("uav-cosim", _text(manifest, "versions", "uav-cosim")),
        ("recorded", f"{len(curves.document)} signals at {rows} instants"),
    ]
    if len(motion.rows) and len(motion.rows) < rows:
        facts.append(("motion", f"{len(motion.rows)} of these instants; straight on in between"))
    if not curves.all_kept:
        facts.append(("plots", "least and greatest value of short stretches; numbers between them are left out"))
    if packets.get("every", 1) > 1:
        facts.append(("packets drawn", f"those of every {packets['every']}th send"))
    facts += [("note", note) for note in manifest.get("notes", ())][:20]
    return [(term, text) for term, text in facts if text.strip()]
