"""Finds the drones of a recording: the columns of position and attitude, and the desired position of the agent.

A drone consists of a vehicle, which is a component that outputs its position (m, NED), and of an agent in the same
system, which is a component that outputs the number of its step and its desired position (m east of the origin). Either
of them may be missing. The FMUs declare these outputs and the law of an agent (`cosim.verdict`), and the manifest of
the run contains the declarations. An FMU without declarations is identified by the names of its outputs
(`cosim.naming`), and its law is not known.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.naming import ATTITUDE, POSITION, STEP, TARGET
from cosim.verdict import Formation, Logged, Role, Rotors, Verdict
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmi.description.declarations import verdicts_of_json
from cosim_master.results.storage.manifest_file import NAME, no_run
from cosim_master.system.flatten.flat import natural
from cosim_master.system.formation import formation_of

__all__ = ["UNKNOWN", "Part", "Player", "parts", "players", "read_manifest"]


@dataclass(frozen=True, slots=True)
class Player:
    """An instance in the manifest: the values of its parameters, and the roles that its FMU declares."""

    parameters: Mapping[str, Any]
    verdicts: Mapping[str, Verdict]

    def named(self, role: Role) -> str:
        """Returns the variable that has a role; empty if none exists."""
        return next((name for name, one in self.verdicts.items() if one is role), "")

    @property
    def position(self) -> str:
        return self.named(Role.POSITION) or POSITION

    @property
    def attitude(self) -> str:
        return self.named(Role.ATTITUDE) or ATTITUDE

    @property
    def target(self) -> tuple[str, Formation]:
        return formation_of(self.verdicts) or (TARGET, Formation(step=STEP))

    @property
    def rotors(self) -> tuple[str, Rotors] | None:
        return next(((name, one) for name, one in self.verdicts.items() if isinstance(one, Rotors)), None)

    @property
    def logged(self) -> Mapping[str, str]:
        """Variables by the place in a DataFlash log that shows them."""
        return {
            place: name for one in self.verdicts.values() if isinstance(one, Logged) for place, name in one.variables
        }


UNKNOWN = Player({}, {})
"""An instance that is not in the manifest."""


@dataclass(frozen=True, slots=True)
class Part:
    """A drone: its name, and the instances that are its vehicle and its agent; "" for a missing one."""

    name: str
    vehicle: str
    agent: str


def read_manifest(run: Path) -> dict[str, Any]:
    """Returns the manifest of a run.

    Raises:
        SystemDescriptionError: the folder has no manifest, or not the manifest of a complete run.
    """
    file = run / NAME
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise SystemDescriptionError([Problem(Where(str(run)), no_run(run, NAME))]) from None
    except (OSError, ValueError) as error:
        raise _incomplete(file, str(error)) from None
    if not isinstance(told, dict):
        raise _incomplete(file, f"a {type(told).__name__}, not an object")
    for name, kind in _KINDS.items():
        if not isinstance(told.get(name, kind()), kind):
            raise _incomplete(file, f"{name} is {json.dumps(told[name])}, not {_IN_JSON[kind]}")
    for note in told.get("notes", ()):
        if not isinstance(note, str):
            raise _incomplete(file, f"a note is {json.dumps(note)}, not a text")
    return told


_KINDS: Mapping[str, type[dict[str, Any] | list[Any]]] = {
    "instances": dict,
    "fmus": dict,
    "packets": dict,
    "changes": list,
    "notes": list,
}
_IN_JSON: Mapping[type[Any], str] = {dict: "an object", list: "an array"}


def _incomplete(file: Path, what: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(file)), f"not the manifest of a complete run: {what}")])


def _values(instance: str, parameters: Any) -> Mapping[str, Any]:
    """Returns the parameters of an instance that have a value. Raises TypeError where one has several."""
    values = {name: value for name, value in dict(parameters).items() if value is not None}
    for name, value in values.items():
        if isinstance(value, dict | list):
            raise TypeError(f"{instance}.{name} is {json.dumps(value)}, not a value")
    return values


def players(run: Path, manifest: Mapping[str, Any]) -> Mapping[str, Player]:
    """Returns the instances of a manifest.

    Raises:
        SystemDescriptionError: the manifest is not that of a complete run.
    """
    try:
        fmus = {path: verdicts_of_json(fmu.get("verdicts", {})) for path, fmu in manifest.get("fmus", {}).items()}
        return {
            name: Player(_values(name, one.get("parameters", {})), fmus.get(one.get("fmu"), {}))
            for name, one in manifest["instances"].items()
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise _incomplete(run / NAME, repr(error)) from None


def parts(columns: Mapping[str, str], known: Mapping[str, Player]) -> list[Part]:
    """Returns the drones in natural order of their names, by the recorded columns and their units."""
    vehicles: set[str] = set()
    agents: set[str] = set()
    for name in {component for column in columns if (component := column.rpartition(".")[0])}:
        of = known.get(name, UNKNOWN)
        if all(columns.get(f"{name}.{of.position}[{i}]") == "m" for i in (1, 2, 3)):
            vehicles.add(name)
        target, formation = of.target
        if f"{name}.{formation.step}" in columns and columns.get(f"{name}.{target}") == "m":
            agents.add(name)
    by_place: dict[str, tuple[list[str], list[str]]] = {}
    for group, all_of in enumerate((vehicles, agents)):
        for component in sorted(all_of):
            by_place.setdefault(component.rpartition(".")[0], ([], []))[group].append(component)
    found: dict[str, tuple[str, str]] = {}
    for place, here in by_place.items():
        if place and max(map(len, here)) == 1:
            found[place] = ("".join(here[0]), "".join(here[1]))
        else:
            found |= {vehicle: (vehicle, "") for vehicle in here[0]}
            for agent in here[1]:
                found[agent] = (found.get(agent, ("", ""))[0], agent)
    return [Part(name, *found[name]) for name in sorted(found, key=natural)]
