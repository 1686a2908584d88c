"""The settings of the master algorithm, from the annotation of the root system.

    <ssc:Annotation type="org.uav-cosim.master">
      <master xmlns="https://uav-cosim.org/ns/1" algorithm="gauss-seidel" order="controller plant">
        <connection to="plant.force" delay="0.01" start="0.5"/>
      </master>
    </ssc:Annotation>

`algorithm`: "jacobi" (the default), "gauss-seidel", "fixed-point", "quasi-newton", "richardson" or "var-step";
docs/masters.md describes the guarantees of each, and its limits.
`order`: a prescribed order of instances that depend on each other; it may be incomplete. With `strictOrder="true"`
(gauss-seidel), it is the order of all instances, whatever their dependencies.
`tolerance`, `iterations`, `relaxation`: settings of the two iterating algorithms. `iterations` of gauss-seidel (1 by
default): groups repeat their step in their order, at most so often, settled or not; "|" in a strict order separates
the groups. `tolerance`, `minimumStep`,
`maximumStep` (s): settings of Richardson. `minimumStep`, `maximumStep` and `constraint` (see `constraints`): settings
of var-step.
`nan`: "refuse" (the default) ends a run with an output that is NaN, "allow" does not.
`extrapolation`: 1 also sets the derivatives of Real inputs, for all connections or for one.
`connection`: the connection that drives the input `to`. `delay` in s: the input at t is the output at t - delay. Before
the first such value, it is `start` (in the input's unit; by default the input's start value). A delayed connection is
not part of the exchange during initialization.

This module reads settings and determines the order of instances.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import (
    EXTRAPOLATION,
    FINE_GRID,
    INPUTS_BY_STEP,
    LOOP_EVENTS,
    LOOP_STATE,
    STEP_CONTROL,
    STEP_COUNTS,
    STEP_DELAY,
    STEP_EVENTS,
    STEP_FRACTION,
)
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.read import Start, Variable
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance, FlatConnection, natural
from cosim_master.system.flatten.init_order import Stage, components, exchange_order
from cosim_master.system.settings.annotation import Attributes, root_annotation
from cosim_master.system.settings.constraints import Constraint, constraints_of, memory_of

__all__ = ["ANNOTATION", "MasterSettings", "Delay", "Target", "connected", "master_settings_of"]

ANNOTATION = "org.uav-cosim.master"


@dataclass(frozen=True, slots=True)
class Traits:
    """Properties of a master algorithm that other modules need.

    Attributes:
        attributes: the attributes of <master> that only some algorithms have.
        ordered: instances step one after the other, in the order of `MasterSettings.sequence`; otherwise all at once.
        iterating: instances that depend on each other repeat the step until their outputs agree.
        in_python: a `Steps` of `execution.algorithms.choice` makes all steps; otherwise the compiled loop makes the
            steps that are not iterated.
        variable: step sizes are determined during the run.
        constrained: constraints determine step sizes; otherwise the error of all continuous outputs does.
    """

    attributes: tuple[str, ...] = ()
    ordered: bool = False
    iterating: bool = False
    in_python: bool = False
    variable: bool = False
    constrained: bool = False

    @property
    def by_error(self) -> bool:
        """True if the error of all continuous outputs determines step sizes."""
        return self.variable and not self.constrained


_OF_ITERATIONS = ("order", "tolerance", "iterations", "relaxation")
ALGORITHMS = {
    "jacobi": Traits(),
    "gauss-seidel": Traits(("order", "strictOrder", "tolerance", "iterations"), ordered=True),
    "fixed-point": Traits(_OF_ITERATIONS, ordered=True, iterating=True),
    "quasi-newton": Traits(_OF_ITERATIONS, ordered=True, iterating=True),
    "richardson": Traits(("tolerance", "minimumStep", "maximumStep"), variable=True),
    "var-step": Traits(("minimumStep", "maximumStep"), variable=True, constrained=True),
}
"""Traits by the value of the attribute `algorithm`."""
_LONGEST = 1_000_000_000
_FINEST_DELAY = 10_000
"""Largest number of base steps in the shortest step for which delayed connections, which store a value per base step,
are possible.
"""
Target = tuple[str, str]
"""An input: instance and variable."""


@dataclass(frozen=True, slots=True)
class Delay:
    """A delayed connection: its delay in ns, and the value before the first delayed one."""

    ns: int
    start: Start
    where: Where


@dataclass(frozen=True, slots=True)
class MasterSettings:
    """The settings of a system's master algorithm.

    Attributes:
        groups: numbers of the instances in the order in which they step; the instances of a group depend on each other.
            Empty for Jacobi.
        loops: the groups that are iterated: those with a loop of dependencies, or with a strict order all of several.
        delays: by input.
        extrapolated: inputs whose derivatives are set.
        tolerance: largest remaining change of the outputs of a loop, or largest growth of the error per second;
            relative to 1 or to the magnitude of the outputs, whichever is larger.
        iterations: largest number of steps of a loop until the outputs converge within the tolerance. Of Gauss-Seidel:
            after so many, the run goes on without convergence.
        relaxation: the fraction of a change that a fixed-point iteration applies.
        minimum_step, maximum_step: of variable steps, ns; 0 leaves them to the algorithm.
        constraints: the constraints that determine the steps of var-step.
        irreversible: the first instances that cannot go back to an earlier state; if any exist, steps of var-step are
            never repeated.
        nan: whether outputs may be NaN.
    """

    algorithm: str = "jacobi"
    groups: tuple[tuple[int, ...], ...] = ()
    delays: Mapping[Target, Delay] = field(default_factory=dict)
    extrapolated: frozenset[Target] = frozenset()
    loops: tuple[tuple[int, ...], ...] = ()
    tolerance: float = 1e-8
    iterations: int = 50
    relaxation: float = 1.0
    minimum_step: int = 0
    maximum_step: int = 0
    constraints: tuple[Constraint, ...] = ()
    irreversible: tuple[str, ...] = ()
    nan: bool = False
    where: Where | None = None
    notes: tuple[str, ...] = ()

    @property
    def variable(self) -> bool:
        """True if step sizes are determined during the run."""
        return ALGORITHMS[self.algorithm].variable

    @property
    def sets_inputs_by_event(self) -> bool:
        """True if discrete inputs of FMUs with Event Mode change in Event Mode, before steps that Python makes.

        Where FMUs step one after the other, or go back, those behind them would not see the outputs of these steps.
        """
        return self.algorithm == "jacobi"

    @property
    def in_python(self) -> bool:
        """True if Python makes the steps instead of the compiled loop."""
        return bool(self.loops) or ALGORITHMS[self.algorithm].in_python

    @property
    def constrained(self) -> bool:
        """True if constraints determine step sizes, so that steps may end at any nanosecond."""
        return ALGORITHMS[self.algorithm].constrained

    @property
    def shows_error(self) -> bool:
        """True if the error of all continuous outputs determines step sizes."""
        return ALGORITHMS[self.algorithm].by_error

    @property
    def memory(self) -> int:
        """The number of values that determine the size of the next step."""
        return memory_of(self.constraints) if self.constrained else int(self.variable)

    @property
    def sequence(self) -> tuple[int, ...]:
        """All instances in the order in which they step."""
        return tuple(i for group in self.groups for i in group)

    def check(self, checked: CheckedSystem, base: int, periods: Sequence[int], per_ns: int = 1) -> None:
        """Checks the settings against the time grid.

        Args:
            base: base step, in ticks.
            periods: period of each instance, in base steps.
            per_ns: ticks per nanosecond.

        Raises:
            SystemDescriptionError: delays that are not multiples of it, or of a base step far below all steps; loops
                with instances of longer steps; Richardson with steps that are not whole nanoseconds.
        """
        seconds = base / (1e9 * per_ns)
        problems = [
            Problem(
                one.where,
                f"delay {one.ns / 1e9:g} s of {'.'.join(target)} is not a multiple of the base step {seconds:.9g} s",
            )
            for target, one in self.delays.items()
            if 2 * abs(one.ns * per_ns - round(one.ns * per_ns / base) * base) >= per_ns
        ]
        if self.delays and min(periods) > _FINEST_DELAY:
            (_, first), shortest = next(iter(self.delays.items())), min(periods) * seconds
            problems.append(
                Problem(first.where, FINE_GRID.text("delayed connections", f"{seconds:.9g}", f"{shortest:.9g}"))
            )
        if self.shows_error and min(periods) > _FINEST_DELAY:
            text = FINE_GRID.text("richardson's rows", f"{seconds:.9g}", f"{min(periods) * seconds:.9g}")
            problems.append(Problem(self.where or checked.structure.where, text))
        if self.shows_error and per_ns > 1:
            problems.append(Problem(self.where or checked.structure.where, STEP_FRACTION.text(f"{seconds:.9g}")))
        for i in (i for loop in self.loops for i in loop):
            if periods[i] > 1:
                one_, size = checked.instances[i], periods[i] * seconds
                text = (
                    f"{self.algorithm}: {one_.name} is part of a loop and steps by {size:g} s, but what iterates "
                    f"must step by the base step, here {seconds:.9g} s"
                )
                problems.append(Problem(one_.where, text))
        if problems:
            raise SystemDescriptionError(problems)


def master_settings_of(checked: CheckedSystem) -> MasterSettings:
    """Returns the master settings of a checked system.

    Raises:
        SystemDescriptionError: the annotation is invalid; all problems are reported at once.
    """
    problems: list[Problem] = []
    reader = root_annotation(checked, ANNOTATION, "master", problems)
    if reader.absent and not problems:
        return MasterSettings()
    algorithm = reader.choice("algorithm", "jacobi", tuple(ALGORITHMS))
    kind = ALGORITHMS[algorithm]
    numbers = _numbers(reader, algorithm)
    sweeps = algorithm == "gauss-seidel" and numbers[1] > 1
    strict = reader.choice("strictOrder", "false", ("true", "false")) == "true" and algorithm == "gauss-seidel"
    words = reader.text("order", "").split()
    order = tuple(word for word in words if not (sweeps and strict and word == "|"))
    every = reader.integer("extrapolation", 0, 0, 1)
    nan = reader.choice("nan", "refuse", ("refuse", "allow")) == "allow"
    children = reader.children("connection", "constraint")
    delays, wanted = _connections(checked, children["connection"], every)
    constraints = constraints_of(checked, children["constraint"])
    if constraints and not kind.constrained:
        reader.problem(f'<constraint> is for algorithm="var-step", this is "{algorithm}"')
    called = "gauss-seidel with iterations" if sweeps else algorithm
    extrapolated = _extrapolated(checked, wanted, every, called, problems)
    groups: tuple[tuple[int, ...], ...] = ()
    loops: tuple[tuple[int, ...], ...] = ()
    notes: tuple[str, ...] = ()
    irreversible: tuple[str, ...] = ()
    if kind.constrained:
        irreversible = tuple(one.name for one in checked.instances if not one.fmu.capabilities.canGetAndSetFMUstate)
        notes = _without_return(checked, constraints, irreversible)
    if kind.variable:
        _refuse_steps(checked, delays, algorithm, irreversible, problems)
    if kind.ordered:
        ranks = _ranks(checked, reader, order)
        if strict:
            groups = _in_order(checked, reader, order)
            groups = _together(checked, groups, words) if sweeps else groups
        else:
            groups = _groups(checked, delays, ranks)
            notes = _notes(checked, groups, kind.iterating or sweeps)
        if kind.iterating or sweeps:
            loops = tuple(group for group in groups if len(group) > 1) if strict else _loops(checked, groups, delays)
            _refuse(checked, loops, algorithm, problems)
    reader.finish()
    if problems:
        raise SystemDescriptionError(problems)
    return MasterSettings(
        algorithm,
        groups,
        delays,
        extrapolated,
        loops,
        *numbers,
        constraints=constraints,
        irreversible=irreversible,
        nan=nan,
        where=reader.where,
        notes=(*notes, *_by_step(checked, algorithm)),
    )


def _by_step(checked: CheckedSystem, algorithm: str) -> tuple[str, ...]:
    """Returns the notes on connected discrete inputs of FMUs with Event Mode that change in Step Mode."""
    if algorithm == "jacobi":
        return ()
    fmus = {one.name: one.fmu for one in checked.instances if one.fmu.capabilities.hasEventMode}
    found: dict[str, dict[str, None]] = {}
    for link in checked.links:
        name, port = link.target
        if name in fmus and fmus[name].variables[port].by_event:
            found.setdefault(name, {})[port] = None
    return tuple(f"{name}: {INPUTS_BY_STEP.text(', '.join(ports), algorithm)}" for name, ports in found.items())


def connected(checked: CheckedSystem, master: MasterSettings) -> CheckedSystem:
    """Returns the system for initialization: delayed connections begin with their start values."""
    if not master.delays:
        return checked
    starts: dict[str, dict[str, Start]] = {}
    for (instance, name), delay in master.delays.items():
        starts.setdefault(instance, {})[name] = delay.start
    kept = {i for stage in checked.init_order for i in stage.links}
    immediate = [i for i in sorted(kept) if checked.links[i].target not in master.delays]
    stages = exchange_order(
        [(checked.links[i].source, checked.links[i].target) for i in immediate],
        {one.name: one.fmu for one in checked.instances},
        [],
    )
    return replace(
        checked,
        instances=tuple(
            replace(one, start_values={**one.start_values, **starts.get(one.name, {})}) for one in checked.instances
        ),
        init_order=tuple(Stage(tuple(immediate[i] for i in stage.links), stage.loop) for stage in stages),
    )


def _connections(
    checked: CheckedSystem, children: Sequence[Attributes], every: int
) -> tuple[dict[Target, Delay], dict[Target, tuple[int, Where]]]:
    """Returns delays, and the inputs that are declared as extrapolated or as not extrapolated."""
    links = {".".join(link.target): link for link in checked.links}
    instances = {one.name: one for one in checked.instances}
    delays: dict[Target, Delay] = {}
    extrapolated: dict[Target, tuple[int, Where]] = {}
    for child in children:
        name = child.text("to", "")
        delay = child.number("delay", 0.0, 0.0, 1e6)
        text = child.text("start", "")
        order = child.integer("extrapolation", every, 0, 1)
        child.finish()
        link = links.get(name)
        if link is None:
            child.problem(f'to="{name}": no connection leads there; {near(name, links)}')
            continue
        instance = instances[link.target[0]]
        variable = instance.fmu.variables[link.target[1]]
        if link.initial_only:
            child.problem(f'to="{name}": it is a parameter, which is set at the start only')
        elif link.target in extrapolated:
            child.problem(f'to="{name}": a second <connection> for it')
        elif not child.text("delay", ""):
            if text:
                child.problem(f'to="{name}": start is for connections with a delay')
            extrapolated[link.target] = (order, child.where)
        elif variable.type in ("String", "Binary"):
            child.problem(
                f'to="{name}": it is a {variable.type}; Reals, Integers, Enumerations and Booleans are delayed'
            )
        else:
            extrapolated[link.target] = (order, child.where)
            start = _start(child, instance, variable, text)
            delays[link.target] = Delay(round(delay * 1e9), start, child.where)
    return delays, extrapolated


def _extrapolated(
    checked: CheckedSystem,
    said: Mapping[Target, tuple[int, Where]],
    every: int,
    algorithm: str,
    problems: list[Problem],
) -> frozenset[Target]:
    """Returns the extrapolated inputs: those declared so; with `every`, all Reals not declared otherwise."""
    fmus = {one.name: one for one in checked.instances}
    found: dict[Target, Where] = {target: where for target, (order, where) in said.items() if order}
    for link in checked.links if every else ():
        real = fmus[link.target[0]].fmu.variables[link.target[1]].type == "Real"
        if real and not link.initial_only and link.target not in said:
            found[link.target] = link.where
    for (name, variable), where in found.items():
        fmu = fmus[name].fmu
        cannot = ""
        if algorithm not in ("jacobi", "gauss-seidel"):
            cannot = f"it is for jacobi and gauss-seidel, this is {algorithm}"
        elif fmu.variables[variable].type != "Real":
            cannot = f"it is a {fmu.variables[variable].type}"
        else:
            cannot = fmu.no_input_derivatives(name)
        if cannot:
            problems.append(Problem(where, EXTRAPOLATION.text(name, variable, cannot)))
    return frozenset(found)


def _start(child: Attributes, instance: ComponentInstance, variable: Variable, text: str) -> Start:
    """Returns the value of a delayed input until the first delayed value arrives."""
    if not text.strip():
        return instance.effective_values().get(variable.name, 0)
    try:
        return variable.parsed(text)
    except ValueError as error:
        child.problem(f'start="{text}" of {instance.name}.{variable.name}: {error}')
        return 0


def _ranks(checked: CheckedSystem, reader: Attributes, order: Sequence[str]) -> list[int]:
    """Returns the position of each instance in a declared order; undeclared instances come last."""
    names = [one.name for one in checked.instances]
    for name in order:
        if name not in names:
            reader.problem(f'order names "{name}", which is not an instance; {near(name, names)}')
    place = {name: n for n, name in reversed(list(enumerate(order)))}
    return [place.get(name, len(order)) for name in names]


def _in_order(checked: CheckedSystem, reader: Attributes, order: Sequence[str]) -> tuple[tuple[int, ...], ...]:
    """Returns each instance as a group of its own, in the declared order, which must contain all of them once."""
    number = {one.name: i for i, one in enumerate(checked.instances)}
    if missing := [name for name in number if name not in order]:
        reader.problem(f"strictOrder: order must contain all instances; missing: {', '.join(missing[:5])}")
    if len(set(order)) < len(order):
        reader.problem("strictOrder: order contains an instance twice")
    return tuple((number[name],) for name in dict.fromkeys(order) if name in number)


def _together(
    checked: CheckedSystem, singles: Sequence[tuple[int, ...]], words: Sequence[str]
) -> tuple[tuple[int, ...], ...]:
    """Returns the groups of a strict order: the instances between two words "|"."""
    after = {name: words[:n].count("|") for n, name in reversed(list(enumerate(words)))}
    groups: dict[int, tuple[int, ...]] = {}
    for single in singles:
        part = after[checked.instances[single[0]].name]
        groups[part] = groups.get(part, ()) + single
    return tuple(groups.values())


def _groups(
    checked: CheckedSystem, delays: Mapping[Target, Delay], ranks: Sequence[int]
) -> tuple[tuple[int, ...], ...]:
    """Returns groups of instances that depend on each other, each after the groups whose outputs it needs.

    Independent groups, and the instances of a group, are sorted by the declared order, then by name.
    """
    number = {one.name: i for i, one in enumerate(checked.instances)}
    edges: list[list[int]] = [[] for _ in number]
    for link in _immediate(checked.links, delays):
        edges[number[link.source[0]]].append(number[link.target[0]])
    component = components(edges)
    members: dict[int, list[int]] = {}
    for i in sorted(range(len(edges)), key=lambda i: (ranks[i], natural(checked.instances[i].name))):
        members.setdefault(component[i], []).append(i)
    after: dict[int, set[int]] = {c: set() for c in members}
    for i, targets in enumerate(edges):
        after[component[i]] |= {component[j] for j in targets} - {component[i]}
    missing = dict.fromkeys(members, 0)
    for later in after.values():
        for c in later:
            missing[c] += 1
    place = {c: n for n, c in enumerate(members)}
    ready = [(place[c], c) for c in members if not missing[c]]
    heapq.heapify(ready)
    groups = []
    while ready:
        _, c = heapq.heappop(ready)
        groups.append(tuple(members[c]))
        for later_one in after[c]:
            missing[later_one] -= 1
            if not missing[later_one]:
                heapq.heappush(ready, (place[later_one], later_one))
    return tuple(groups)


def _immediate(links: Sequence[FlatConnection], delays: Mapping[Target, Delay]) -> list[FlatConnection]:
    return [link for link in links if not link.initial_only and link.target not in delays]


def _numbers(reader: Attributes, algorithm: str) -> tuple[float, int, float, int, int]:
    """Returns tolerance, iterations and relaxation; minimum and maximum step."""
    tolerance = reader.number("tolerance", 1e-4 if ALGORITHMS[algorithm].by_error else 1e-8, 1e-15, 1.0)
    iterations = reader.integer("iterations", 1 if algorithm == "gauss-seidel" else 50, 1, 100_000)
    if algorithm == "gauss-seidel" and iterations == 1 and reader.text("tolerance", ""):
        reader.problem("tolerance: gauss-seidel uses it with iterations above 1 only")
    relaxation = reader.number("relaxation", 1.0, 1e-6, 2.0)
    steps = [round(1e9 * reader.number(name, 0.0, 0.0, 1e6)) for name in ("minimumStep", "maximumStep")]
    if all(steps) and steps[0] > steps[1]:
        reader.problem("minimumStep is larger than maximumStep")
    for name in dict.fromkeys(name for one in ALGORITHMS.values() for name in one.attributes):
        if name not in ALGORITHMS[algorithm].attributes and reader.text(name, ""):
            algorithms = [one for one, kind in ALGORITHMS.items() if name in kind.attributes]
            reader.problem(f'{name} is for algorithm="{" or ".join(algorithms)}", this is "{algorithm}"')
    return tolerance, iterations, relaxation, steps[0], steps[1]


def _loops(
    checked: CheckedSystem, groups: Sequence[tuple[int, ...]], delays: Mapping[Target, Delay]
) -> tuple[tuple[int, ...], ...]:
    """Returns the groups that contain a loop of dependencies."""
    to_itself = {link.source[0] for link in _immediate(checked.links, delays) if link.source[0] == link.target[0]}
    return tuple(group for group in groups if len(group) > 1 or checked.instances[group[0]].name in to_itself)


def _refuse(checked: CheckedSystem, loops: Sequence[Sequence[int]], algorithm: str, problems: list[Problem]) -> None:
    """Adds problems for members of loops that cannot be iterated."""
    for one in (checked.instances[i] for loop in loops for i in loop):
        flags = one.fmu.capabilities
        if not flags.canGetAndSetFMUstate:
            text = LOOP_STATE.text(algorithm, one.name, one.fmu.remedy("canGetAndSetFMUstate"))
            problems.append(Problem(one.where, text))
        if flags.hasEventMode:
            text = LOOP_EVENTS.text(algorithm, one.name)
            problems.append(Problem(one.where, text))


def _refuse_steps(
    checked: CheckedSystem,
    delays: Mapping[Target, Delay],
    algorithm: str,
    irreversible: Sequence[str],
    problems: list[Problem],
) -> None:
    """Adds the problems of variable steps. If FMUs cannot go back, events cannot be located, either."""
    needed = ["canGetAndSetFMUstate"] if ALGORITHMS[algorithm].by_error else []
    for one in checked.instances:
        for flag in (*needed, "canHandleVariableCommunicationStepSize"):
            if not getattr(one.fmu.capabilities, flag):
                text = STEP_CONTROL.text(algorithm, flag, one.name, one.fmu.remedy(flag))
                problems.append(Problem(one.where, text))
        if irreversible and one.fmu.capabilities.hasEventMode:
            problems.append(Problem(one.where, STEP_EVENTS.text(algorithm, one.name, irreversible[0])))
    for target, delay in delays.items():
        text = STEP_DELAY.text(algorithm, ".".join(target))
        problems.append(Problem(delay.where, text))


def _without_return(
    checked: CheckedSystem, constraints: Sequence[Constraint], irreversible: Sequence[str]
) -> tuple[str, ...]:
    if not irreversible or not any(one.ports for one in constraints):
        return ()
    remedies = {one.name: one.fmu.remedy("canGetAndSetFMUstate") for one in checked.instances}
    first = irreversible[0]
    return (STEP_COUNTS.text(first, remedies[first]),)


def _notes(checked: CheckedSystem, groups: Sequence[Sequence[int]], iterated: bool) -> tuple[str, ...]:
    loops = [", ".join(checked.instances[i].name for i in group) for group in groups if len(group) > 1]
    how = "are iterated together" if iterated else "step in this order"
    return tuple(f"these depend on each other, and {how}: {names}" for names in loops[:5])
