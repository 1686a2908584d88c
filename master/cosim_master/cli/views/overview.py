"""The overview of a run on one page: outcome, participants, radio traffic and recordings."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from rich.table import Table
from rich.text import Text

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where, counted
from cosim_master.results.reading.links import statistics
from cosim_master.results.reading.message_names import message_names
from cosim_master.results.reading.read import has_packets, packets
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.storage.journal import FOLDER, goes_on
from cosim_master.results.storage.last_call import last_call
from cosim_master.results.storage.manifest_file import UNWRITTEN

__all__ = ["overview", "overview_tables", "signal_table"]

_MESSAGES, _FINDINGS, _GATEWAYS, _NAMES, _ERROR = 6, 3, 2, 6, 4
"""Lines of each kind that fit on a screen of 24 lines with a prompt; names of a list that is not shortened."""


def overview(folder: Path) -> dict[str, Any]:
    """Returns the JSON document that `uav-cosim info` prints about a run; docs/command-line.md describes it.

    Raises:
        SystemDescriptionError: the folder does not hold the complete results of a run.
    """
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        with open_signals(folder) as signals:
            schema, times = signals.schema_arrow, signals.read(columns=["time"])["time"]
        seconds = times[-1].as_py() - manifest["start_time"] if len(times) else 0.0
        table = packets(folder).select(_COLUMNS) if has_packets(folder) else None
        instances = sorted({str(one["fmu"]) for one in manifest["instances"].values()})
        network = manifest["network"]
        document = {
            "kind": "run",
            "system": manifest["system"]["name"],
            "outcome": manifest["outcome"],
            "error": _error(folder, manifest),
            "simulated_s": manifest["simulated_s"],
            "wall_s": manifest["wall_s"],
            "real_time_factor": manifest["real_time_factor"],
            "seed": manifest["seed"],
            "instances": len(manifest["instances"]),
            "fmus": [Path(fmu).name for fmu in instances],
            "nodes": _nodes(table),
            "radio": {name: network[name] for name in ("topology", "latency", "jitter", "loss", "range")},
            "packets": manifest["packets"],
            "links": None if table is None else manifest.get("links") or statistics(folder),
            "messages": [] if table is None else _messages(table, seconds),
            "gateways": manifest["gateways"],
            "verdict": manifest.get("verdict"),
            "notes": manifest["notes"],
            "rows": len(times),
            "signals": [
                {"name": one.name, "type": str(one.type), "unit": (one.metadata or {}).get(b"unit", b"").decode()}
                for one in schema
            ],
        }
        list(overview_tables(document))  # also looks at the types of what it shows
        return document
    except (OSError, ValueError, LookupError, TypeError, AttributeError, CosimError) as error:
        text = f"is not the complete result of a run: {error}"
        raise SystemDescriptionError([Problem(Where(str(folder)), text)]) from None


def _error(folder: Path, manifest: Mapping[str, Any]) -> str | None:
    """Returns the error of a run, also of one that could not write it."""
    error: str | None = manifest["error"]
    if manifest["outcome"] == "failed" and error is None:
        return UNWRITTEN + ("; `uav-cosim repair` completes them" if (folder / FOLDER).is_dir() else "")
    if manifest["outcome"] != "running" or goes_on(folder):
        return error
    call = last_call(folder)
    last = "" if call is None else f"; the last call of an FMU in it was {call}"
    return f"the process was killed{last}; `uav-cosim repair` completes the recording"


_COLUMNS = ["sent", "source", "target", "message", "sequence", "outcome"]


def _nodes(table: pa.Table | None) -> list[str]:
    """Returns the nodes to which packets were addressed, in natural order (drone2 before drone10)."""
    if table is None:
        return []
    from cosim_master.system.flatten.flat import natural

    return sorted((name for name in table["target"].unique().to_pylist() if name), key=natural)


def _messages(table: pa.Table, seconds: float) -> list[dict[str, Any]]:
    """Returns each kind of message with its senders, its rate per sender and its packets' fates, most frequent first.

    A packet for three nodes counts as one sent message and as three radio transmissions.
    """
    sends = table.group_by(["message", "source", "sent", "sequence"]).aggregate([])
    sent = sends.group_by("message").aggregate([([], "count_all"), ("source", "count_distinct")]).to_pylist()
    fared = table.group_by(["message", "outcome"]).aggregate([([], "count_all")]).to_pylist()
    found = []
    for one in sent:
        outcomes = {row["outcome"]: row["count_all"] for row in fared if row["message"] == one["message"]}
        senders = one["source_count_distinct"]
        found.append(
            {
                "id": one["message"],
                "name": message_names().get(one["message"], f"message {one['message']}"),
                "senders": senders,
                "sent": one["count_all"],
                "rate": one["count_all"] / senders / seconds if seconds > 0.0 else None,
                "radio": outcomes.get("radio", 0),
                "lost": sum(n for outcome, n in outcomes.items() if outcome.startswith("lost")),
                "on_board": outcomes.get("on board", 0),
            }
        )
    return sorted(found, key=lambda message: (-message["sent"], message["id"]))


def overview_tables(run: Mapping[str, Any]) -> Iterator[Table | str]:
    """Returns an overview for people, which fits on one screen for any number of drones."""
    yield (
        f"{run['system']}: {run['outcome']}, {run['simulated_s']:g} s simulated in {run['wall_s']:.2f} s "
        f"({run['real_time_factor']:.1f} times real time), seed {run['seed']}"
    )
    if run["error"] is not None:
        lines = run["error"].splitlines()
        yield "\n".join([f"error: {lines[0]}", *lines[1:_ERROR]])
        if (more := len(lines) - _ERROR) > 0:
            yield f"and {counted(more, 'more line')} (manifest.json has all)"
    yield from _verdict(run["verdict"], failed=run["outcome"] == "failed")
    yield f"instances: {run['instances']} of {len(run['fmus'])} FMUs ({_listed(run['fmus'])})"
    if run["nodes"]:
        radio = run["radio"]
        yield f"nodes: {len(run['nodes'])} ({_listed(run['nodes'])})"
        yield (
            f"radio: {radio['topology']}, latency {radio['latency']:g} s, jitter {radio['jitter']:g} s, "
            f"loss {radio['loss']:g}, range {_range(radio['range'])}"
        )
    packets = run["packets"]
    why = [f"{name.removeprefix('lost: ')} {n}" for name, n in packets.items() if name.startswith("lost: ") and n]
    yield (
        f"packets: {packets['sent']} sent by radio, {packets['delivered']} delivered, {packets['lost']} lost"
        + (f" ({', '.join(why)})" if why else "")
        + f", {packets['on board']} on board"
    )
    yield from _worst_link(run["links"])
    if run["messages"]:
        yield from _message_table(run["messages"])
    for name, counts in list(run["gateways"].items())[:_GATEWAYS]:
        crossed = ", ".join(f"{n} {what}" for what, n in counts.items() if what != "address" and n)
        yield f"gateway {name} ({counts['address']}): {crossed or 'nothing has crossed'}"
    if (more := len(run["gateways"]) - _GATEWAYS) > 0:
        yield f"and {more} more gateways"
    signals = counted(len(run["signals"]) - 1, "signal")
    yield f"recorded: {counted(run['rows'], 'row')} of {signals} (--signals lists them)"


def _verdict(verdict: Mapping[str, Any] | None, *, failed: bool) -> Iterator[str]:
    if verdict is None:
        return
    findings = [finding for finding in verdict["findings"] if finding["severity"] != "note"]
    for finding in findings[:_FINDINGS]:
        time = "" if finding["time"] is None else f" at {finding['time']:g} s"
        yield f"{finding['severity']}{time}: {finding['text']}"
    if (more := len(findings) - _FINDINGS) > 0:
        yield f"and {more} more failures and warnings (manifest.json has all)"
    if not findings and not failed:
        good = f"no failures or warnings from {verdict['from']:g} to {verdict['to']:g} s"
        notes = len(verdict["findings"])
        yield f"verdict: {good}" + (f"; {counted(notes, 'note')} (manifest.json has them)" if notes else "")
    if (nearest := verdict.get("nearest")) is not None:
        who = " and ".join(nearest["who"])
        yield f"nearest approach: {nearest['distance']:.2f} m, {who} at {nearest['time']:g} s"


def _worst_link(links: Mapping[str, Any] | None) -> Iterator[str]:
    """Returns the number of links, and the link with the largest share of losses; nothing if nothing was lost."""
    if links and links["worst"] and (worst := links["worst"][0])["lost"]:
        causes = ", ".join(f"{cause} {n}" for cause, n in worst["causes"].items())
        lost = f"{worst['lost']} of {worst['sent']} lost ({causes})"
        yield f"links: {links['count']}, most losses from {worst['from']} to {worst['to']}: {lost}"


def _message_table(messages: Sequence[Mapping[str, Any]]) -> Iterator[Table | str]:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("message", "senders", "1/s each", "by radio", "lost", "on board"):
        table.add_column(Text(column), justify="left" if column == "message" else "right")
    for one in messages[:_MESSAGES]:
        rate = "" if one["rate"] is None else f"{one['rate']:.3g}"
        numbers = (str(one["senders"]), rate, *(str(one[name]) for name in ("radio", "lost", "on_board")))
        table.add_row(Text(one["name"]), *numbers)
    yield table
    if (more := len(messages) - _MESSAGES) > 0:
        yield f"and {more} more kinds of messages (--json lists them)"


def _listed(names: Sequence[str]) -> str:
    """Returns all names if they are few, otherwise the first two and the last."""
    return ", ".join(names if len(names) <= _NAMES else [*names[:2], "...", names[-1]])


def _range(value: float | str) -> str:
    return "unlimited" if value == "INF" else f"{value:g} m"


def signal_table(run: Mapping[str, Any]) -> Iterator[Table | str]:
    """Returns a table of all signals of a run."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("signal", "type", "unit"):
        table.add_column(column)
    for one in run["signals"]:
        table.add_row(Text(one["name"]), one["type"], Text(one["unit"]))
    yield f"{counted(run['rows'], 'row')} of time and {counted(len(run['signals']) - 1, 'signal')}:"
    yield table
