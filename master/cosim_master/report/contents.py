"""The contents of a report: tables about one run, and the comparison of several."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import CosimError, SystemDescriptionError, counted
from cosim_master.results.reading.comparison import compare
from cosim_master.results.reading.flight import Flight, read_flight
from cosim_master.results.reading.links import Links, read_links
from cosim_master.results.reading.read import has_packets
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.reading.roles import read_manifest

__all__ = [
    "Run",
    "Table",
    "agents",
    "differences",
    "findings",
    "links",
    "origins",
    "parameters",
    "read_run",
    "repetition",
    "summary",
    "timing",
]

_ROWS = 200
"""Rows of a table; a note says how many more there are."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table.

    Attributes:
        title: its heading.
        head: of the columns.
        rows: texts, all of one length.
        note: below it.
    """

    title: str
    head: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def shortened(self) -> Table:
        """Returns the table with at most `_ROWS` rows."""
        if len(self.rows) <= _ROWS:
            return self
        more = f"{_ROWS} of {len(self.rows)} rows. {self.note}".strip()
        return Table(self.title, self.head, self.rows[:_ROWS], more)


@dataclass(frozen=True, slots=True)
class Run:
    """A run to report on; None for what was not recorded."""

    folder: Path
    manifest: Mapping[str, Any]
    flight: Flight | None
    links: Links | None

    @property
    def name(self) -> str:
        return str((self.manifest.get("system") or {}).get("name") or self.folder.name)


def read_run(folder: Path) -> Run:
    """Reads a run.

    Raises:
        CosimError: the folder has no manifest of a run, or its signals or packets are incomplete.
    """
    manifest = read_manifest(folder)
    open_signals(folder).close()
    try:
        flight = read_flight(folder)
    except SystemDescriptionError:  # the signals are damaged
        raise
    except CosimError:
        flight = None  # a run without vehicles has a report all the same
    return Run(folder, manifest, flight, read_links(folder) if has_packets(folder) else None)


def summary(run: Run) -> list[tuple[str, str]]:
    """Returns the most important facts of a run, as pairs of term and value."""
    manifest, packets = run.manifest, run.manifest.get("packets") or {}
    verdict = manifest.get("verdict") or {}
    nearest = verdict.get("nearest")
    links = run.links
    return [
        ("outcome", str(manifest.get("outcome", ""))),
        *([("error", str(manifest["error"]))] if manifest.get("error") else []),
        (
            "findings",
            f"{counted(verdict.get('failures', 0), 'failure')}, {counted(verdict.get('warnings', 0), 'warning')}",
        ),
        *([("nearest approach", _nearest(nearest))] if nearest else []),
        ("simulated", f"{_number(manifest.get('simulated_s'))} s"),
        (
            "computed in",
            f"{_number(manifest.get('wall_s'))} s ({_number(manifest.get('real_time_factor'))} x real time)",
        ),
        ("start-up", f"{_number(manifest.get('start_up_s'))} s"),
        ("instances", f"{len(manifest.get('instances', {}))} of {len(manifest.get('fmus', {}))} FMUs"),
        (
            "packets",
            f"{packets.get('sent', 0)} sent, {packets.get('delivered', 0)} delivered, {packets.get('lost', 0)} lost",
        ),
        *([("mean delay", f"{1e3 * float(np.mean(links.delays)):.4g} ms")] if links and len(links.delays) else []),
        ("master", str((manifest.get("master") or {}).get("algorithm", ""))),
        ("base step", f"{_number(manifest.get('base_step'))} s"),
        ("seed", str(manifest.get("seed", ""))),
    ]


def _nearest(nearest: Mapping[str, Any]) -> str:
    who = " and ".join(nearest.get("who", ()))
    return f"{_number(nearest.get('distance'))} m, {who}, at {_number(nearest.get('time'))} s"


def _number(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, (int, float)) else str(value if value is not None else "-")


def findings(run: Run) -> Table:
    """Returns the findings of the verdict, including those of monitors."""
    found = (run.manifest.get("verdict") or {}).get("findings", ())
    rows = [
        (
            str(one.get("severity", "")),
            _number(one["time"]) if one.get("time") is not None else "",
            ", ".join(map(str, one.get("who", ()))),
            str(one.get("text", "")),
        )
        for one in found
    ]
    return Table("Findings", ("severity", "time (s)", "who", "finding"), rows).shortened()


def parameters(run: Run) -> Table:
    """Returns the values that were assigned with their origins, changes during the run, and settings."""
    rows = []
    for instance, one in run.manifest.get("instances", {}).items():
        for variable, made in (one.get("assigned") or {}).items():
            used = (one.get("parameters") or {}).get(variable)
            rows.append((f"{instance}.{variable}", made["text"] if used is None else _number(used), _origin(made)))
    before = [
        (name, value, f"--set until {_number(one['until'])} s")
        for one in run.manifest.get("settings_before") or ()
        for name, value in _settings(one["settings"]).items()
    ]
    since = f" from {_number(run.manifest.get('checkpoint_time', 0.0))} s on" if before else ""
    now = _settings(run.manifest.get("settings") or {})
    settings = [*before, *((name, value, f"--set{since}") for name, value in now.items())]
    changes = [
        (str(one["variable"]), _number(one["value"]), f"--at {_number(one['time'])} s")
        for one in run.manifest.get("changes", ())
    ]
    note = "Other parameters have the start values of their FMUs; manifest.json contains all values."
    return Table("Parameters", ("parameter", "value", "set by"), [*settings, *changes, *rows], note).shortened()


def _origin(made: Mapping[str, str]) -> str:
    path, colon, line = made["where"].rpartition(":")
    where = f"{Path(path).name}:{line}" if colon else made["where"]
    return f"{where} ({made['name']})" if made["where"] == "--set" else where


def agents(run: Run) -> Table | None:
    """Returns the errors of each agent on a line; None without agents and vehicles."""
    if run.flight is None:
        return None
    flight, rows = run.flight, []
    point = flight.law[0] if flight.law is not None else {}
    for drone in flight.drones:
        if drone.errors is None or drone.position is None:
            continue
        last, largest, rms = drone.errors
        end = f"{abs(drone.position[-1, 1] - point[drone.name]):.4g}" if drone.name in point else ""
        role = "stays" if drone.stays else "moves"
        rows.append((drone.name, role, f"{last:.4g}", f"{largest:.4g}", f"{rms:.4g}", end))
    if not rows:
        return None
    head = ("drone", "agent", "final error (m)", "largest error (m)", "RMS error (m)", "to the law's fixed point (m)")
    note = "Errors are distances between desired and actual position east, since the first step."
    return Table("Agents", head, rows, note).shortened()


def links(run: Run) -> Table | None:
    """Returns the statistics of the links by radio, those with most losses first; None without packets."""
    if run.links is None or not len(run.links.sent):
        return None
    one = run.links
    rows = [
        (
            one.nodes[one.source[i]],
            one.nodes[one.target[i]],
            str(int(one.sent[i])),
            str(int(one.lost[i])),
            f"{100.0 * one.lost[i] / one.sent[i]:.3g}",
            ", ".join(f"{cause} {n}" for cause, n in one.causes_of(i).items()),
            "" if np.isnan(one.mean[i]) else f"{1e3 * one.mean[i]:.4g}",
        )
        for i in one.worst()[:_ROWS]
    ]
    head = ("from", "to", "packets", "lost", "lost (%)", "causes", "mean delay (ms)")
    note = f"{_ROWS} of {len(one.sent)} rows." if len(one.sent) > _ROWS else ""
    return Table("Links", head, rows, note)


def timing(run: Run) -> list[Table]:
    """Returns the time profile of a run with --profile."""
    profile = run.manifest.get("profile")
    if not profile:
        return []
    fmus = [
        (
            str(one["fmu"]),
            str(one["instances"]),
            str(one["steps"]),
            *(f"{one[name]:.4g}" for name in ("set", "do_step", "get")),
            f"{1e6 * (one['set'] + one['do_step'] + one['get']) / max(1, one['steps']):.3g}",
        )
        for one in profile.get("fmus", ())
    ]
    head = ("FMU", "instances", "steps", "set (s)", "doStep (s)", "get (s)", "us per step")
    phases = [(str(name), f"{value:.4g}") for name, value in profile.get("phases", {}).items()]
    return [Table("Time in FMUs", head, fmus), Table("Time by phase", ("phase", "time (s)"), phases)]


def origins(run: Run) -> Table:
    """Returns the FMUs and the versions of the programs."""
    fmus = [
        (Path(path).name, str(one.get("model", "")), str(one.get("sha256", "")))
        for path, one in run.manifest.get("fmus", {}).items()
    ]
    programs = [(name, str(version), "") for name, version in (run.manifest.get("versions") or {}).items()]
    return Table("FMUs and versions", ("file or program", "model or version", "SHA-256"), [*fmus, *programs])


def repetition(run: Run) -> str:
    """Returns the command that repeats a run, for a shell; several, each in a line, if settings changed during it."""
    manifest = run.manifest
    system = ["uav-cosim", "run", str((manifest.get("system") or {}).get("path", run.name))]
    words: list[str] = []
    given: dict[str, str] = {}
    for one in manifest.get("instances", {}).values():
        for made in (one.get("assigned") or {}).values():
            if made["where"] == "--set":
                given[made["name"]] = made["text"]
    before = manifest.get("settings_before") or []
    changed = [_settings(one["settings"]) for one in before]
    now = _settings(manifest.get("settings") or {})
    if manifest.get("posted"):  # packets of a person or a program; the values set are repeated with them
        words += ["--replay", str(run.folder)]
    else:
        for change in manifest.get("changes", ()):
            value = str(change["value"])
            value = value.lower() if isinstance(change["value"], bool) else value
            words += ["--at", f"{change['time']:.12g} {change['variable']}={value}"]
    if path := (manifest.get("input") or {}).get("path"):
        words += ["--input", str(path)]
    asked = {one["step"] for one in manifest.get("instances", {}).values() if one.get("step_by") == "--step"}
    for step in sorted(asked):
        words += ["--step", f"{step:.12g}"]
    for pattern in (manifest.get("recording") or {}).get("signals", ()):
        words += ["--record", pattern]
    for name in ("variant", "solver"):
        if text := manifest.get(name):
            words += [f"--{name}", str(text)]
    start = manifest.get("start_time") or 0.0
    end = (manifest.get("checkpoint_time") or start) + (manifest.get("simulated_s") or 0.0)
    words += ["--seed", str(manifest.get("seed", 1)), "--until", f"{end:.12g}"]
    commands: list[str] = []
    origin: list[str] = []
    for n, one in enumerate(before, start=1):
        folder, until = f"{run.folder.name}-until-{n}", one["until"]
        kept = ["--checkpoint-every", f"{until - start:.12g}", "-o", folder]
        commands.append(shlex.join([*system, *origin, *_set(given | changed[n - 1]), *words, *kept]))
        given, origin = {}, ["--from", f"{folder}@{until:.12g}"]
    return "\n".join([*commands, shlex.join([*system, *origin, *_set(given | now), *words])])


def _settings(tags: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    return {f"{tag}.{name}": str(value) for tag, given in tags.items() for name, value in given.items()}


def _set(values: Mapping[str, str]) -> list[str]:
    return [word for name, value in values.items() for word in ("--set", f"{name}={value}")]


def programs(run: Run) -> list[str]:
    """Returns the gateways through which programs have sent packets into a run, which no command repeats."""
    repeated = {"@page"} if run.manifest.get("posted") else set()
    found = run.manifest.get("gateways") or {}
    return [name for name, counts in found.items() if counts.get("received") and name not in repeated]


def differences(runs: Sequence[Run]) -> list[Table]:
    """Returns the comparison of runs: their facts side by side, and the differences of each to the first."""
    facts = [dict(summary(run)) for run in runs]
    terms = list(dict.fromkeys(term for fact in facts for term in fact))
    names = [run.folder.name for run in runs]
    tables = [Table("Comparison", ("", *names), [(term, *(fact.get(term, "") for fact in facts)) for term in terms])]
    for run in runs[1:]:
        found = compare(runs[0].folder, run.folder)
        causes = [(path, str(one), str(other)) for path, (one, other) in found.causes.items()]
        head = f"{runs[0].folder.name} and {run.folder.name}"
        alike = "The recordings are equal." if found.equal else "The recordings differ."
        tables.append(Table(f"Inputs: {head}", ("input", names[0], run.folder.name), causes, alike).shortened())
        signals = [
            (one.name, f"{one.absolute:.4g}", _number(one.time), _number(one.first))
            for one in found.signals
            if not one.equal
        ][:30]
        columns = ("signal", "largest difference", "at (s)", "differs from (s)")
        tables.append(Table(f"Signals: {head}", columns, signals, "The largest differences." if signals else ""))
    return tables
