"""The manifest of a run, manifest.json: its inputs and its outcome."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections import ChainMap
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.fmi.description.declarations import verdicts_as_json
from cosim_master.fmi.description.read import Start
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.overrides import apart
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Channel, Network
from cosim_master.system.structure import Component, System

__all__ = ["digest_of_system", "manifest"]


def manifest(
    ready: Prepared,
    result: RunResult,
    start_up: float,
    parameters: Mapping[str, ChainMap[str, Start]],
    fingerprint: Mapping[str, str],
) -> dict[str, Any]:
    """Returns the manifest of a run, as JSON.

    Args:
        start_up: wall-clock time before the first step, s.
        parameters: of each instance, as its FMU answered.
        fingerprint: digests of all inputs that the recording depends on.
    """
    checked = ready.checked
    return {
        **_result(result),
        "start_up_s": start_up,
        "real_time_factor": result.real_time_factor,
        "system": {
            "name": checked.structure.name,
            "path": str(checked.structure.path),
            "sha256": digest_of_system(checked),
        },
        **_input(ready),
        "fingerprint": dict(fingerprint),
        "start_time": ready.clock.time(0),
        "base_step": ready.clock.seconds(1),
        "changes": _changes(ready),
        "master": _master(ready.master),
        "seed": ready.network.seed,
        "settings": {tag: dict(given) for tag, given in checked.settings.items()},
        "network": _network(ready.network),
        "recording": asdict(ready.recording),
        "packets": dict(result.packets),
        "gateways": {name: dict(counts) for name, counts in result.gateways.items()},
        "instances": _instances(ready, parameters),
        "fmus": _fmus(checked),
        "versions": dict(_versions()),
        "notes": list(result.notes),
        **({} if result.profile is None else {"profile": asdict(result.profile)}),
    }


@cache
def _versions() -> Mapping[str, str]:
    """Returns the versions of Python and of the packages that decide what is recorded; each is read from a file."""
    names = ("uav-cosim", "numba", "numpy", "pyarrow", "fmpy")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}


def _result(result: RunResult) -> dict[str, Any]:
    return {
        "outcome": result.outcome,
        "error": None if result.error is None else str(result.error),
        "verdict": None if result.verdict is None else result.verdict.as_json(failed=result.outcome == "failed"),
        "simulated_s": result.simulated_s,
        "wall_s": result.wall_s,
    }


def _input(ready: Prepared) -> dict[str, Any]:
    if ready.stimuli is None:
        return {}
    return {"input": {"path": str(ready.stimuli.path), "sha256": ready.stimuli.digest}}


def _changes(ready: Prepared) -> list[dict[str, Any]]:
    return [
        {
            "time": ready.clock.time(change.k),
            "variable": f"{ready.checked.instances[change.instance].name}.{change.variable.name}",
            "value": _in_json(change.value),
        }
        for change in ready.changes
    ]


def settings_before(ready: Prepared, checkpoint: Checkpoint) -> list[dict[str, Any]]:
    """Returns the settings of radio, recording and master before the present ones, in the form of the manifest.

    Each has the time until which they held, s. The list is empty if they are the present ones.
    """
    structure = ready.checked.structure
    found: list[dict[str, Any]] = []
    with suppress(OSError, ValueError, AttributeError, TypeError, KeyError):  # the folder may be gone, or damaged
        told = json.loads((checkpoint.run / "manifest.json").read_text(encoding="utf-8"))
        found = [one for one in told.get("settings_before", ()) if one["until"] < checkpoint.time]
    last = {tag: dict(given) for tag, given in apart(checkpoint.overrides, structure)[1].items()}
    found.append({"until": checkpoint.time, "settings": last})
    now = {tag: dict(given) for tag, given in ready.checked.settings.items()}
    following = [*(one["settings"] for one in found[1:]), now]
    return [one for one, then in zip(found, following, strict=True) if one["settings"] != then]


def as_changes(ready: Prepared, made: Sequence[tuple[int, str, str]]) -> list[dict[str, Any]]:
    """Returns changes that led to a checkpoint, with values as Python writes them, in the form of the manifest."""
    texts = {
        f"{one.name}.{name}"
        for one in (ready.checked.instances if made else ())
        for name, variable in one.fmu.variables.items()
        if variable.type == "String"
    }

    def value(name: str, text: str) -> Any:
        return text if name in texts else text == "True" if text in ("True", "False") else _in_json(_number(text))

    return [{"time": ready.clock.time(k), "variable": name, "value": value(name, text)} for k, name, text in made]


def _number(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _master(master: MasterSettings) -> dict[str, Any]:
    return {
        "algorithm": master.algorithm,
        "extrapolated": sorted(".".join(target) for target in master.extrapolated),
        "tolerance": master.tolerance,
        "iterations": master.iterations,
        "relaxation": master.relaxation,
        "minimum_step": master.minimum_step / 1e9,
        "maximum_step": master.maximum_step / 1e9,
        "constraints": [asdict(one) for one in master.constraints],
        "delays": {".".join(target): delay.ns / 1e9 for target, delay in master.delays.items()},
    }


def _network(network: Network) -> dict[str, Any]:
    found = {
        f.name: _in_json(getattr(network, f.name))
        for f in fields(network)
        if f.name not in ("nodes", "gateways", "dialect", "trace", "own", "notes")
    }
    found["channels"] = [_channel_in_json(channel) for channel in network.channels]
    found["dialect"] = [message.name for message in network.dialect]
    found["links"] = sorted(map(list, network.links))
    trace = network.trace
    found["trace"] = None if trace is None else {"file": trace.file, "sha256": trace.sha256, "rows": len(trace.rows)}
    own = network.own
    found["channel"] = None if own is None else {"file": own.file, "sha256": own.sha256}
    for name in ("partitions", "jamming", "obstacles"):
        found[name] = [{key: _in_json(value) for key, value in asdict(one).items()} for one in getattr(network, name)]
    found["outages"] = [[n, a, b if math.isfinite(b) else "INF"] for n, a, b in network.outages]
    return found


def _instances(ready: Prepared, parameters: Mapping[str, ChainMap[str, Start]]) -> dict[str, Any]:
    instances, clock = ready.checked.instances, ready.clock
    layers = {id(layer): layer for values in parameters.values() for layer in values.maps}
    in_json = {key: {name: _in_json(value) for name, value in layer.items()} for key, layer in layers.items()}
    assigned: dict[str, dict[str, Any]] = {}
    for (name, variable), made in ready.checked.assignments.items():
        told = {"name": made[-1].name, "text": made[-1].text, "where": str(made[-1].where)}
        assigned.setdefault(name, {})[variable] = told
    return {
        instance.name: {
            "fmu": str(instance.fmu.path),
            "step": clock.seconds(period),
            "step_by": source,
            **({} if instance.solver is None else {"solver": asdict(instance.solver)}),
            "parameters": ChainMap(*(in_json[id(layer)] for layer in parameters[instance.name].maps)),
            "assigned": assigned.get(instance.name, {}),
        }
        for instance, period, source in zip(instances, clock.periods, clock.sources, strict=True)
    }


def _fmus(checked: CheckedSystem) -> dict[str, Any]:
    fmus = {str(i.fmu.path): i.fmu for i in checked.instances}
    return {
        path: {
            "sha256": fmu.digest,
            "guid": fmu.guid,
            "model": fmu.model_name,
            "verdicts": verdicts_as_json(fmu.verdicts),
        }
        for path, fmu in sorted(fmus.items())
    }


def _channel_in_json(channel: Channel) -> dict[str, Any]:
    numbers = {f.name: getattr(channel, f.name) for f in fields(channel) if f.default is None}
    given = {name: value for name, value in numbers.items() if value is not None}
    return {"from": channel.source, "to": channel.target, **given}


def _in_json(value: Any) -> Any:
    """Returns a value for JSON, which has no infinity: it is written as in XML Schema."""
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"


def digest_of_system(checked: CheckedSystem) -> str:
    """Returns the digest of the root document and of every document below it, in the order of their paths."""
    documents: set[Path] = {checked.structure.document}

    def visit(system: System) -> None:
        documents.add(system.document)
        for element in system.elements:
            if isinstance(element, Component):
                if element.content is not None:
                    visit(element.content)
            elif isinstance(element, System):
                visit(element)

    visit(checked.structure.system)
    digest = hashlib.sha256()
    for document in sorted(documents):
        digest.update(document.read_bytes())
    return digest.hexdigest()
