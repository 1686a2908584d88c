"""Builds a swarm in Python and saves it as ordinary SSP.

    swarm = Swarm("pair")
    swarm.add("west", position=(0.0, 0.0), stays=True)
    swarm.add("middle", position=(0.0, 5.0), vehicle="fmus/Mine.fmu")
    swarm.add("east", position=(0.0, 40.0), stays=True)
    swarm.connect("west", "middle")
    swarm.connect("middle", "east")
    swarm.save("pair")
    simulate(swarm)

The result is an ordinary system folder: one .ssd for each kind of drone, to which the drones of the root SSD refer, and
one .ssv with the differences between them. It has no trace of being generated.

Drones consist of the parts of a scenario, which other FMUs may replace. The start position of a drone, its system id
and its neighbours are set by the parameters that the FMUs declare for them.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where, WriteFailed
from cosim_master.diagnostics.names import did_you_mean, near, similar
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.description.read import FmuDescription
from cosim_master.system import shipped
from cosim_master.system.authoring.fitting import OWN, companions
from cosim_master.system.authoring.swarm.description import (
    HERE,
    PARAMETERS,
    Member,
    SwarmDescription,
    attribute,
    monitor_element,
    own_parameters,
    wrong,
)
from cosim_master.system.authoring.swarm.drone import (
    Drone,
    declared,
    described,
    exchanged,
    found_fmu,
    parameters_of,
    without,
)
from cosim_master.system.authoring.swarm.scenario import Scenario, scenario_of
from cosim_master.system.authoring.swarm.surroundings import COUNT, SharedPorts, body_of
from cosim_master.system.authoring.text.difference import difference
from cosim_master.system.authoring.text.documents import parameter_document, system_document
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import ROOT_DOCUMENT, read_system
from cosim_master.system.structure import Connection, System

__all__ = ["IDS", "Swarm"]

IDS = 250
"""System ids in use; a system id of MAVLink has one byte."""
_SCENARIO = "line5"
_RECORDED_EVERY = 0.1
"""s; rows at every base step of thousands of drones would be far too many."""


class Swarm:
    """A system under construction: drones, and the radio links and connections between them.

    Args:
        name: name of the system.
        like: the system whose first drone is the pattern of all drones, and whose radio and environments they have: a
            file, a folder, or the name of a shipped one.
        network: attributes of the annotation of the network that replace those of `like`, e.g. {"loss": 0.1}; sequences
            for lists of numbers or names.
        stop_time: stop time of the DefaultExperiment, s; None: that of `like`.
        recorded_every: time between two rows of a recording, s.
        fmus: folder in which FMUs of models are searched before those of this project.

    Attributes:
        notes: the omitted parts of `like`, and values of its drone that FMUs of the drones lack, for the user.

    Raises:
        SystemDescriptionError: `like` is not the pattern of a swarm.
    """

    def __init__(
        self,
        name: str = "swarm",
        *,
        like: str | Path | Scenario = _SCENARIO,
        network: Mapping[str, Any] | None = None,
        stop_time: float | None = None,
        recorded_every: float = _RECORDED_EVERY,
        fmus: Path = OWN,
    ) -> None:
        scenario = like if isinstance(like, Scenario) else scenario_of(like)
        self.name = name
        self.notes = scenario.notes
        self._drone = scenario.drone
        self._network = {**scenario.network, **{key: attribute(key, value) for key, value in (network or {}).items()}}
        self._topology = None if network is None else network.get("topology")
        self._annotations = scenario.annotations
        self._numbered = scenario.numbered
        self._rising = scenario.rising
        self._ways = scenario.ways
        self._stop_time = scenario.stop_time if stop_time is None else _seconds("stop_time", stop_time)
        self._recorded_every = recorded_every
        self._fmus = fmus
        self._members: dict[str, Member] = {}
        self._drones = self._systems = 0  # numbers of drones, and of members with a system id
        self._links: dict[tuple[str, str], None] = {}
        self._connections: dict[tuple[str, str], Connection] = {}  # by the end of each
        self._monitors: list[etree._Element] = []
        self._environments: list[tuple[Member, SharedPorts]] = []
        self._known: dict[Path, FmuDescription] = {}
        self._kinds: dict[tuple[tuple[str, Path], ...], Drone] = {(): self._drone}
        self._folder: Path | None = None
        for one in scenario.surroundings:
            self.environment(one.fmu, name=one.name, values=one.values)

    # ---- contents ----------------------------------------------------------------------------------------------------

    @property
    def members(self) -> tuple[str, ...]:
        """The names of all drones and FMUs, in the order in which they were added."""
        return tuple(self._members)

    def add(
        self,
        name: str = "",
        *,
        position: Sequence[float] | np.ndarray[Any, Any] = (),
        system_id: int | None = None,
        stays: bool = False,
        values: Mapping[str, Any] | None = None,
        fmu: str | Path | None = None,
        **parts: str | Path,
    ) -> str:
        """Adds a drone, or with `fmu` a single FMU of the root.

        Args:
            name: name of its component; "drone1", "drone2", ... if it is empty.
            position: start position, (north, east) or (north, east, down) [m]; if it is empty, that of its FMU.
            system_id: its MAVLink system id; by default 1 for the first drone and the next number for each further one;
                after 250, 1 follows.
            stays: it is stationary, if its agent follows a law with stationary agents.
            values: start values by PART.VARIABLE ("agent.altitude"), or by variable for a single FMU. Arrays require
                sequences.
            fmu: the single FMU.
            parts: FMUs that replace parts of the drone, or are added to it, `vehicle="Mine"`. An FMU is a file or
                the name of a model that has been built. The name of an added part must not be close to that of a part
                that the drone has, `agnt`, unless it differs by a number, `agent2`.

        Returns:
            The name.

        Raises:
            SystemDescriptionError: the name is already used, the FMU or variable does not exist, or a value cannot be
                assigned.
        """
        given = self._checked_name(name or f"drone{self._drones + 1}")
        if fmu is not None and parts:
            raise wrong(given, f"is one FMU: it has no parts ({', '.join(parts)})")
        self._check_parts(given, parts)
        drone = self._kind(parts) if fmu is None else None
        fmus = self._described({"": fmu}) if drone is None and fmu is not None else self._kind(parts).fmus
        member = Member(
            name=given,
            parts=fmus,
            drone=drone,
            declared=declared(fmus),
            place=_place(given, position),
            id=self._next_id() if system_id is None else _system_id(given, system_id),
            stays=bool(stays),
            numbered={path: self._drones + 1 for path in self._numbered if drone is not None and _has(fmus, path)},
            values=tuple(
                p
                for path, value in ({**(self._risen(fmus) if drone is not None else {}), **(values or {})}).items()
                for p in parameters_of(fmus, path, value)
            ),
        )
        self._check_member(member)
        self._members[given] = member
        self._drones += drone is not None
        for environment, ports in self._environments if drone is not None else ():
            self._surround(environment, ports, member, self._drones - 1)
        self._systems += bool(member.declared.system_ids)
        self._folder = None
        return given

    def connect(self, first: str, second: str) -> None:
        """Connects two drones by radio, or two ports.

        Drones, "drone1" and "drone2", get a radio link; the topology of the network is then "listed". If their agents
        follow a law on a line, `second` is the eastern neighbour of `first`. Ports, "wind.velocity" and
        "drone1.vehicle.wind", get connections, one for each element of an array; one must be an output and the
        other an input. Inside a drone, "drone1.vehicle.position" and "drone1.sensor.truth", a connection replaces the
        one that the input has from the template or by its name; drones with equal connections share a description.

        Raises:
            SystemDescriptionError: the drone or port does not exist, the ports are incompatible, or a drone already has
                this neighbour.
        """
        ends = [self._end(one) for one in (first, second)]
        if all(not port for _, port in ends):
            self._link(ends[0][0], ends[1][0])
        elif all(port for _, port in ends):
            self._wire(*(self._port(member, port) for member, port in ends))
        else:
            raise wrong(f"{first}, {second}", "are a drone and a port: connect two drones, or two ports")
        self._folder = None

    def environment(
        self, fmu: str | Path, *, name: str = "environment", values: Mapping[str, Any] | None = None
    ) -> str:
        """Adds an FMU that all drones share, such as the air around them, and connects it with each of them.

        A port of the FMU is connected with the port of the same name, and of the opposite direction, of each drone's
        body: if that port has three elements, the first three elements belong to the first drone, the next three to the
        second, and so on. Drones that are added later are connected as well. If the FMU has a parameter `count`, it is
        set to the number of drones. `notes` tells which ports a vehicle lacks.

        Args:
            fmu: a file, or the name of a model that has been built.
            name: name of its component.
            values: start values by variable; arrays require sequences.

        Returns:
            The name.

        Raises:
            SystemDescriptionError: as for `add`; or the FMU has no port in common with a drone, or too few elements.
        """
        given = self.add(name, fmu=fmu, values=values)
        member = self._members[given]
        ports = SharedPorts(member.parts[""])
        try:
            for number, drone in enumerate([one for one in self._members.values() if one.drone is not None]):
                self._surround(member, ports, drone, number)
        except SystemDescriptionError:
            del self._members[given]
            self._connections = {
                end: one for end, one in self._connections.items() if given not in (one.start_element, one.end_element)
            }
            raise
        self._environments.append((member, ports))
        return given

    def monitor(
        self, kind: str, *, signals: str | Sequence[str] | Mapping[str, str | Mapping[str, str]] = (), **attributes: Any
    ) -> None:
        """Adds a monitor beside those of `like` (docs/monitors.md): monitor("separation", least=2.0, end=True).

        Args:
            kind: name of its element: "order", "separation", "limit", "fence", "convergence", "age" or "formula".
            signals: patterns of signals; for a formula, these by name: {"x": "drone*.agent.target"}, with another
                quantity {"v": {"of": "drone*.vehicle.velocity", "quantity": "magnitude"}}.
            attributes: its attributes; sequences for lists of numbers or names, `from_` for `from`.

        `check` and `simulate` compare it with the system, since drones may be added later.
        """
        self._monitors.append(monitor_element(kind, signals, attributes))
        self._folder = None

    # ---- SSP ---------------------------------------------------------------------------------------------------------

    @property
    def system(self) -> System:
        """Returns the root system with the systems of drones inside, equal to that of `read_system` after saving."""
        return self._description().root(Path())[0]

    def save(self, folder: str | Path) -> Path:
        """Writes the swarm as a system folder, which must not exist.

        The files are read back and compared, and their structure and values are checked (`cosim_master.check`); a
        system that this refuses is removed. Attributes of the network and of monitors are read by `simulate` and
        `uav-cosim check` only, which refuse wrong ones.

        Raises:
            SystemDescriptionError: the folder exists, the swarm is empty, or `check` refuses it.
            WriteFailed: the folder cannot be written.
        """
        target = Path(folder)
        if target.exists():
            raise SystemDescriptionError([Problem(Where(str(target)), "exists already")])
        if not self._members:
            raise wrong(self.name, "has no drones: add() them")
        part = target.with_name(f".{target.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        try:
            part.mkdir(parents=True)
            description = self._description()
            root, kinds = description.root(part)
            for file, drone in kinds.items():
                (part / file).write_bytes(system_document(drone.system, part))
            (binding,) = root.parameter_bindings or (None,)
            if binding is not None:
                (part / PARAMETERS).write_bytes(parameter_document(self.name, binding.parameters))
            (part / ROOT_DOCUMENT).write_bytes(description.document(root, part))
            with read_system(part) as written:
                if written.problems:
                    raise SystemDescriptionError(written.problems)
                if (text := difference(root, written.system, "the system")) is not None:
                    raise wrong(self.name, f"cannot be saved as it is: {text}")
                check(written)
            part.replace(target)
        except SystemDescriptionError as error:
            raise SystemDescriptionError(
                Problem(Where(one.where.path.replace(str(part), str(target)), one.where.line), one.message)
                for one in error.problems
            ) from None
        except OSError as error:
            raise WriteFailed(str(target), error.strerror or str(error)) from error
        finally:
            shutil.rmtree(part, ignore_errors=True)
        self._folder = target
        return target

    def __fspath__(self) -> str:
        """Returns the folder that the swarm was saved to, so that `simulate` and other users of paths accept a swarm.

        Raises:
            SystemDescriptionError: the swarm has not been saved, or has been changed since.
        """
        if self._folder is None:
            raise wrong(self.name, "is not saved as it is: call save(FOLDER) first")
        return str(self._folder)

    # ---- members -----------------------------------------------------------------------------------------------------

    def _checked_name(self, name: str) -> str:
        if name in self._members:
            raise wrong(name, "is in this swarm already: give each drone a name of its own")
        if "." in name:
            raise wrong(name, "is not a name of a component: names have no dots")
        return name

    def _check_parts(self, name: str, parts: Iterable[str]) -> None:
        """Refuses new parts whose names are those of parts of the drone except for a few letters."""
        known = self._drone.fmus
        for part in parts:
            if part not in known and part.rstrip("0123456789_") not in known and (close := similar(part, known)):
                text = f"has no part {part}; {did_you_mean(close)} If it is to be a new part, give it another name"
                raise wrong(name, text)

    def _next_id(self) -> int:
        return self._systems % IDS + 1

    def _described(self, given: Mapping[str, str | Path]) -> dict[str, FmuDescription]:
        files = {part: found_fmu(one, self._fmus) for part, one in given.items()}
        new = {str(file): file for file in files.values() if file not in self._known}
        self._known.update({Path(key): one for key, one in described(new).items()})
        return {part: self._known[file] for part, file in files.items()}

    def _kind(self, parts: Mapping[str, str | Path]) -> Drone:
        """Returns the drone with these FMUs in place of its own; equal drones share one object.

        Other parts that do not accept them, such as the autopilot of another kind of vehicle, are replaced, too.
        """
        fmus = self._described(parts)
        key = tuple(sorted((part, fmu.path) for part, fmu in fmus.items()))
        if key not in self._kinds:
            drone = exchanged(self._drone, fmus)
            others = companions(drone.system, drone.fmus, fmus, (self._fmus, shipped.fmus()))
            self._kinds[key] = exchanged(self._drone, {**fmus, **others}) if others else drone
            for path, fmu in without(self._drone, {**fmus, **others}):
                self._note(f"{path} of the template is left out: {fmu.path.name} has no such parameter")
        return self._kinds[key]

    def _risen(self, fmus: Mapping[str, FmuDescription]) -> dict[str, float]:
        """Returns the start values of the next drone that rise from drone to drone."""
        return {path: first + self._drones * rise for path, first, rise in self._rising if _has(fmus, path)}

    def _check_member(self, member: Member) -> None:
        if len(member.place) not in (0, 2, 3):
            raise wrong(member.name, f"is placed at {member.place}: give (north, east) or (north, east, down) in m")
        names = ", ".join(fmu.path.name for fmu in member.parts.values())
        if member.place and not member.declared.start:
            raise wrong(member.name, f"has a position: {names} must declare one StartPosition (docs/verdict.md)")
        if member.stays and not (member.declared.formation and member.declared.formation.stays):
            raise wrong(
                member.name, f"cannot be told to stay: {names} must declare a Formation with stays (docs/verdict.md)"
            )
        own = {name for name, _, _ in own_parameters(member)}
        if taken := [one.name for one in member.values if one.name in own]:
            text = "is set by position, system_id, stays or connect(): leave it out of values"
            raise wrong(f"{member.name}.{taken[0]}", text)

    def _end(self, text: str) -> tuple[Member, str]:
        name, _, port = text.partition(".")
        if name not in self._members:
            raise wrong(text, f"there is no {name} in this swarm; {near(name, self._members)}")
        return self._members[name], port

    # ---- links and connections ---------------------------------------------------------------------------------------

    def _link(self, first: Member, second: Member) -> None:
        for one in (first, second):
            if one.drone is None:
                raise wrong(one.name, "is one FMU: only drones have radio links; connect its ports")
        pairs = ((first.name, second.name), (second.name, first.name))
        if first is second or any(pair in self._links for pair in pairs):
            raise wrong(f"{first.name}, {second.name}", "are one drone, or connected already")
        sides = ((first, 1, second, "an eastern"), (second, 0, first, "a western"))
        sided = [one for one in sides if one[0].declared.formation is not None]
        for one, side, _, what in sided:
            if (other := one.neighbours[side]) is not None:
                raise wrong(one.name, f"has {what} neighbour already: {other.name}")
        for one, side, other, _ in sided:
            one.neighbours[side] = other
        self._links[pairs[0]] = None

    def _port(self, member: Member, port: str) -> tuple[Member, str, tuple[str, ...], str]:
        """Returns a port of a member: its part, its elements, and its causality."""
        part, _, name = port.rpartition(".")
        if part not in member.parts:
            known = [one for one in member.parts if one]
            text = f"write {member.name}.PART.PORT; its parts are {', '.join(known)}" if known else "it has no parts"
            raise wrong(f"{member.name}.{port}", text)
        variables = member.parts[part].variables
        elements = elements_of(name, variables)
        kinds = {variables[one].causality for one in elements}
        if not kinds <= {"input", "output"} or not elements:
            ports = dict.fromkeys(
                v.name.partition("[")[0] for v in variables.values() if v.causality in ("input", "output")
            )
            raise wrong(f"{member.name}.{port}", f"there is no input or output {name}; {near(name, ports)}")
        return member, part, elements, kinds.pop()

    def _wire(self, *ends: tuple[Member, str, tuple[str, ...], str]) -> None:
        about = ", ".join(".".join(filter(None, (member.name, part, some[0]))) for member, part, some, _ in ends)
        (first, source, here, out), (second, target, there, into) = ends
        if (out, into) == ("input", "output"):
            self._wire(*reversed(ends))
            return
        if out == into or len(here) != len(there):
            fix = "an output with an input" if out == into else "ports with equal numbers of elements"
            raise wrong(about, f"are {out} and {into} with {len(here)} and {len(there)} elements: connect {fix}")
        if first is second:
            self._wire_inside(first, source, here, target, there)
            return
        outer = []
        for member, part, elements, _ in ends:
            member.exposed += [(part, one) for one in elements if (part, one) not in member.exposed]
            outer.append(tuple(_outside(part, one) for one in elements))
        for start, end, inside in zip(*outer, there, strict=True):
            if (second.name, end) in self._connections or (target, inside) in second.inner:
                raise wrong(f"{second.name}.{end}", "is driven already: an input has one connection")
            self._connections[second.name, end] = Connection(first.name, start, second.name, end, HERE)

    def _wire_inside(self, member: Member, source: str, here: Sequence[str], target: str, there: Sequence[str]) -> None:
        """Connects outputs and inputs of two parts of one drone."""
        if source == target:
            raise wrong(f"{member.name}.{source}" if source else member.name, "is one FMU: connect it with another")
        for start, end in zip(here, there, strict=True):
            if (target, end) in member.inner or (member.name, _outside(target, end)) in self._connections:
                raise wrong(f"{member.name}.{target}.{end}", "is driven already: an input has one connection")
            member.inner[target, end] = (source, start)

    def _surround(self, environment: Member, ports: SharedPorts, drone: Member, number: int) -> None:
        """Connects an environment with the drone of this number, from 0."""
        part, fmu = body_of(drone.parts), environment.parts[""]
        if part is None or not [*ports.of(drone.parts[part], 0)]:
            raise wrong(environment.name, f"has no port in common with {drone.name}")
        try:
            pairs = [*ports.of(drone.parts[part], number)]
        except ValueError as error:
            raise wrong(environment.name, str(error)) from None
        for elements, causality, own, opposite in pairs:
            self._wire((environment, "", elements, causality), (drone, part, own, opposite))
        body = drone.parts[part].path.name
        if lacking := ports.missing(drone.parts[part]):
            note = f"{body} has no {', '.join(lacking)}: {fmu.path.name} does not act on it by these"
            self._note(note)
        if COUNT in fmu.variables:
            others = (one for one in environment.values if one.name != COUNT)
            environment.values = (*others, *parameters_of(environment.parts, COUNT, number + 1))

    def _note(self, text: str) -> None:
        self.notes = tuple(dict.fromkeys((*self.notes, text)))

    def _description(self) -> SwarmDescription:
        return SwarmDescription(
            name=self.name,
            members=tuple(self._members.values()),
            links=tuple(self._links),
            connections=tuple(self._connections.values()),
            network=self._network,
            topology=self._topology,
            ways=self._ways,
            annotations=self._annotations,
            stop_time=self._stop_time,
            recorded_every=self._recorded_every,
            monitors=tuple(self._monitors),
        )


def _seconds(name: str, given: Any) -> float:
    """Returns a time that is given as a number."""
    try:
        return float(given)
    except (TypeError, ValueError):
        raise wrong(name, f"is {given!r}; give a number in s") from None


def _outside(part: str, port: str) -> str:
    """Returns the name of a port of a part outside the system of its drone."""
    return f"{part}_{port}" if part else port


def _place(name: str, position: Any) -> tuple[float, ...]:
    """Returns a position that is given as a sequence of finite numbers."""
    try:
        place = (math.nan,) if isinstance(position, str) else tuple(float(one) for one in position)
    except (TypeError, ValueError):
        place = (math.nan,)
    if not all(map(math.isfinite, place)):
        raise wrong(name, f"is placed at {position!r}: give (north, east) or (north, east, down) in m")
    return place


def _system_id(name: str, given: Any) -> int:
    """Returns a system id that is given as an integer."""
    if isinstance(given, bool) or not isinstance(given, int | np.integer):
        raise wrong(name, f"has the system id {given!r}: give a whole number from 1 to 255")
    return int(given)


def _has(fmus: Mapping[str, FmuDescription], path: str) -> bool:
    part, _, name = path.rpartition(".")
    return part in fmus and name in fmus[part].variables
