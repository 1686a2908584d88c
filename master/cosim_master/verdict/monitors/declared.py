"""The monitors that a system declares: the annotation org.uav-cosim.monitors, checked against the system.

    <ssc:Annotation type="org.uav-cosim.monitors">
      <monitors xmlns="https://uav-cosim.org/ns/1">
        <order axis="0 1 0" start="25"/>
        <separation vehicles="drone*" least="2" end="true"/>
        <limit signals="drone*.vehicle.attitude" quantity="tilt" most="0.6"/>
        <fence polygon="-20 -20  -20 120  20 120  20 -20" ceiling="30" severity="warning"/>
        <convergence signals="drone3.agent.target" goal="50" amplitude="40" time="15" floor="1" start="25"/>
        <age from="drone*" to="drone*" most="1"/>
        <formula text="speed > 1 -> eventually[0,5] speed &lt;= 1">
          <signal name="speed" of="drone*.vehicle.velocity" quantity="magnitude"/>
        </formula>
      </monitors>
    </ssc:Annotation>

docs/monitors.md and docs/annotations.md explain elements and attributes.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from cosim.verdict import Role
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.diagnostics.names import is_pattern, matching, near, near_pattern
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.slaves.fmi2 import set_kind
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.annotation import Attributes, root_annotation
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid
from cosim_master.verdict.earshot import heard_by_relays
from cosim_master.verdict.monitors.formula import TIME, Formula, FormulaError, parse
from cosim_master.verdict.monitors.temporal import Evaluation

__all__ = [
    "ANNOTATION",
    "Age",
    "Convergence",
    "Fence",
    "FormulaMonitor",
    "Limit",
    "Monitor",
    "Monitors",
    "Order",
    "Quantity",
    "Separation",
    "Signal",
    "monitored",
    "monitors_of",
]

NEAR = 1e-9
"""s by which a communication point, computed from integers, may differ from a time as written."""
ANNOTATION = "org.uav-cosim.monitors"
_KINDS = ("order", "separation", "limit", "fence", "convergence", "age", "formula")
Quantity = Literal["value", "magnitude", "tilt"]
_QUANTITIES = ("value", "magnitude", "tilt")
_MOST_PAIRS = 1_000_000
_NANO = 1e-9
_NAME = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True, slots=True)
class Signal:
    """A number that is computed from variables of one instance.

    Attributes:
        name: "component.variable", or the name of an array.
        variables: (instance, variable), several for an array.
        unit: of the variables; empty if they have none.
        quantity: the variable itself, the Euclidean norm of an array, or the angle [rad] between the downward axis of a
            body and the vertical, from its attitude, a quaternion.
    """

    name: str
    variables: tuple[tuple[str, str], ...]
    unit: str = ""
    quantity: Quantity = "value"


@dataclass(frozen=True, slots=True)
class Monitor:
    """The properties that all monitors have.

    Attributes:
        name: unique in the system.
        kind: name of the element.
        severity: of its findings.
        ends: whether the first violation ends the run.
        start, stop: the time from which on, and up to which, it judges [s].
    """

    name: str
    kind: str
    severity: Literal["failure", "warning"] = "failure"
    ends: bool = False
    start: float = -math.inf
    stop: float = math.inf


@dataclass(frozen=True, slots=True)
class Order(Monitor):
    """Vehicles remain in their order along an axis (a unit vector, NED), at least `least` [m] apart along it."""

    vehicles: tuple[Signal, ...] = ()
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    least: float = 0.0


@dataclass(frozen=True, slots=True)
class Separation(Monitor):
    """Any two vehicles remain at least `least` [m] apart."""

    vehicles: tuple[Signal, ...] = ()
    least: float = 0.0


@dataclass(frozen=True, slots=True)
class Limit(Monitor):
    """Signals remain between `least` and `most`."""

    signals: tuple[Signal, ...] = ()
    least: float = -math.inf
    most: float = math.inf


@dataclass(frozen=True, slots=True)
class Fence(Monitor):
    """Vehicles remain inside of a circle or a polygon (north, east [m]), and between two heights [m above the origin].

    `polygon` is empty for a circle; a `radius` that is infinite is no border.
    """

    vehicles: tuple[Signal, ...] = ()
    centre: tuple[float, float] = (0.0, 0.0)
    radius: float = math.inf
    polygon: tuple[tuple[float, float], ...] = ()
    floor: float = -math.inf
    ceiling: float = math.inf


@dataclass(frozen=True, slots=True)
class Convergence(Monitor):
    """|signal - goal| <= amplitude exp(-(t - start) / time) + floor, from `start` on."""

    signals: tuple[Signal, ...] = ()
    goals: tuple[float, ...] = ()
    amplitude: float = 0.0
    time: float = 1.0
    floor: float = 0.0


@dataclass(frozen=True, slots=True)
class Age(Monitor):
    """A node has heard from another one at most `most` [s] ago; `pairs`: numbers of (sender, receiver)."""

    pairs: tuple[tuple[int, int], ...] = ()
    nodes: tuple[str, ...] = ()
    most: float = math.inf


@dataclass(frozen=True, slots=True)
class FormulaMonitor(Monitor):
    """A formula holds at every instant; `signals` has one signal for each column, or one for all columns."""

    formula: Formula = field(default_factory=lambda: parse("true"))
    signals: Mapping[str, tuple[Signal, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Monitors:
    """The monitors of a system, and the time between two instants that they see [s]; None: all communication points."""

    every: tuple[Monitor, ...] = ()
    interval: float | None = None
    notes: tuple[str, ...] = ()


def monitored(monitors: Monitors) -> frozenset[tuple[str, str]]:
    """Returns all variables that the monitors need, as pairs of instance and variable."""
    return frozenset(variable for one in monitors.every for signal in _signals(one) for variable in signal.variables)


def _signals(monitor: Monitor) -> Iterable[Signal]:
    if isinstance(monitor, (Order, Separation, Fence)):
        return monitor.vehicles
    if isinstance(monitor, (Limit, Convergence)):
        return monitor.signals
    if isinstance(monitor, FormulaMonitor):
        return [signal for signals in monitor.signals.values() for signal in signals]
    return ()


def monitors_of(
    checked: CheckedSystem, network: Network | None, clock: TimeGrid | None, *, gridless: bool = False
) -> Monitors:
    """Returns the monitors that a system declares.

    Args:
        network: None if it is invalid: its nodes are then not compared with those of the monitors.
        clock: of the run; None if it is invalid: intervals are then not compared with it.

    Raises:
        SystemDescriptionError: the annotation is invalid; all problems are reported at once.
    """
    problems: list[Problem] = []
    root = root_annotation(checked, ANNOTATION, "monitors", problems)
    interval = root.number("interval", 0.0, 0.0, 1e6)
    base = None if clock is None else clock.seconds(1)
    root.finish()
    if interval and base is not None and abs(interval / base - round(interval / base)) > 1e-9 * interval / base:
        root.problem(f'interval="{interval:g}" is not a multiple of the base step, {base:.9g} s')
    reader = _Reader(checked, network, base or _NANO)
    found = [reader.monitor(kind, one) for kind, one in _in_order(root)]
    if not root.absent and not found and not problems:
        root.problem(f"<monitors> has no monitors: valid are {', '.join(_KINDS)}")
    counted = Counter(one.name for one in found)
    for name in [name for name, n in counted.items() if n > 1]:
        root.problem(f'{counted[name]} monitors have the name "{name}": give each a name of its own')
    if problems:
        raise SystemDescriptionError(problems)
    steps = round(interval / base) if interval and base else 0 if gridless else 1
    notes = () if clock is None else _notes(found, clock, steps)
    return Monitors(tuple(found), interval or None, tuple(notes))


def _notes(monitors: Iterable[Monitor], clock: TimeGrid, steps: int) -> Iterator[str]:
    """Yields notes about the monitors that judge nothing before the end of the run.

    Args:
        steps: base steps between the instants that are judged; 0: they are not known before the run.
    """
    begin, stop = clock.time(0), clock.time(clock.steps)
    for one in monitors:
        first = math.ceil((max(one.start, begin) - begin - NEAR) / clock.seconds(steps)) * steps if steps else 0
        if one.start > stop:
            yield f"monitor {one.name} judges nothing: it starts at {one.start:g} s, and the run stops at {stop:g} s"
        elif isinstance(one, FormulaMonitor) and max(one.start, 0.0) + one.formula.horizon > stop:
            told = f"looks {one.formula.horizon:g} s ahead"
            if one.start > begin:
                told = f"starts at {one.start:g} s and {told}"
            yield f"monitor {one.name} judges nothing: it {told}, and the run stops at {stop:g} s"
        elif (
            isinstance(one, Limit | Convergence | Fence | FormulaMonitor)
            and steps
            and (first > clock.steps or clock.time(first) > one.stop + NEAR)
        ):
            every = f"every {clock.seconds(steps):.9g} s from {begin:g} s on"
            yield f"monitor {one.name} judges nothing: no instant lies between its start and stop; they come {every}"


def _in_order(root: Attributes) -> list[tuple[str, Attributes]]:
    """Returns the readers of all monitors with their kinds, in the order of the file."""
    found = [(kind, one) for kind, some in root.children(*_KINDS).items() for one in some]
    place = {id(child): n for n, child in enumerate(() if root.element is None else root.element)}
    return sorted(found, key=lambda item: place[id(item[1].element)])


class _Reader:
    """Reads the elements of monitors."""

    def __init__(self, checked: CheckedSystem, network: Network | None, base: float) -> None:
        self._checked, self._network, self._base = checked, network, base
        self._numbers: Counter[str] = Counter()
        self._vehicles: dict[str, Signal] | None = None
        self._scalars: dict[str, Signal] = {}
        self._arrays: dict[str, Signal] = {}
        self._makers: Mapping[str, Callable[[str, Attributes], Monitor]] = {
            "order": self._order,
            "separation": self._separation,
            "limit": self._limit,
            "fence": self._fence,
            "convergence": self._convergence,
            "age": self._age,
            "formula": self._formula,
        }

    def monitor(self, kind: str, one: Attributes) -> Monitor:
        made = self._makers[kind](kind, one)
        one.finish()
        if kind != "formula":
            one.children()
        return made

    def _common(self, kind: str, one: Attributes) -> tuple[str, str, Literal["failure", "warning"], bool, float, float]:
        self._numbers[kind] += 1
        number = self._numbers[kind]
        name = one.text("name", "") or (kind if number == 1 else f"{kind} {number}")
        is_failure = one.choice("severity", "failure", ("failure", "warning")) == "failure"
        ends = one.choice("end", "false", ("false", "true")) == "true"
        start = one.optional("start", -1e9, 1e9)
        stop = one.number("stop", math.inf, -1e9, math.inf)
        if start is not None and stop < start:
            one.problem(f'stop="{stop:g}" is before start="{start:g}"')
        return name, kind, "failure" if is_failure else "warning", ends, -math.inf if start is None else start, stop

    # ---- kinds ---------------------------------------------------------------------------------------------------

    def _order(self, kind: str, one: Attributes) -> Monitor:
        axis = _numbers(one, "axis", "0 1 0")
        length = math.sqrt(sum(value * value for value in axis))
        if len(axis) != 3 or not length:
            one.problem(f'axis="{one.text("axis", "")}" must be three numbers, a vector in NED, not all zero')
            axis, length = [0.0, 1.0, 0.0], 1.0
        north, east, down = (value / length for value in axis)
        least = one.number("least", 0.0, 0.0, 1e9)
        return Order(*self._common(kind, one), self._bodies(one, 2), (north, east, down), least)

    def _separation(self, kind: str, one: Attributes) -> Monitor:
        least = _required(one, "least", 0.0, 1e9)
        return Separation(*self._common(kind, one), self._bodies(one, 2), least)

    def _limit(self, kind: str, one: Attributes) -> Monitor:
        least, most = one.optional("least", -1e300, 1e300), one.optional("most", -1e300, 1e300)
        if least is None and most is None:
            one.problem("it needs the attribute least or most")
        signals = self._named(one, "signals", _quantity(one))
        least, most = -math.inf if least is None else least, math.inf if most is None else most
        if least > most:
            one.problem(f'least="{least:g}" is greater than most="{most:g}"')
        for name, bound in (("least", least), ("most", most)):
            if signals and signals[0].quantity == "tilt" and math.pi < bound < math.inf:
                text = f'{name}="{bound:g}" is more than any tilt, which is in rad and at most pi'
                one.problem(f"{text}; {bound:g} degrees are {math.radians(bound):.4g}")
        return Limit(*self._common(kind, one), signals, least, most)

    def _fence(self, kind: str, one: Attributes) -> Monitor:
        corners = _numbers(one, "polygon", "")
        if len(corners) % 2 or len(corners) == 2 or len(corners) == 4:
            one.problem(f"polygon has {len(corners)} numbers: it needs north and east of at least three corners")
            corners = []
        radius = one.optional("radius", 0.0, 1e9)
        north, east = one.number("north", 0.0, -1e9, 1e9), one.number("east", 0.0, -1e9, 1e9)
        if corners and radius is not None:
            one.problem("a fence is a polygon or a circle: leave out polygon, or radius")
        if radius is None and any(one.text(name, "").strip() for name in ("north", "east")):
            one.problem("north and east are the centre of a circle: it needs a radius")
        floor, ceiling = one.optional("floor", -1e9, 1e9), one.optional("ceiling", -1e9, 1e9)
        if not corners and radius is None and floor is None and ceiling is None:
            one.problem("it needs a polygon, a radius, a floor or a ceiling")
        if floor is not None and ceiling is not None and floor > ceiling:
            one.problem(f'floor="{floor:g}" is above ceiling="{ceiling:g}"')
        return Fence(
            *self._common(kind, one),
            self._bodies(one, 1),
            (north, east),
            math.inf if radius is None else radius,
            tuple(zip(corners[::2], corners[1::2], strict=True)),
            -math.inf if floor is None else floor,
            math.inf if ceiling is None else ceiling,
        )

    def _convergence(self, kind: str, one: Attributes) -> Monitor:
        signals, goals = self._named(one, "signals", _quantity(one)), _numbers(one, "goal", "")
        if len(goals) not in {1, len(signals) or 1}:
            one.problem(
                f"goal has {len(goals)} numbers: it needs one for all signals, or one for each of {len(signals)}"
            )
        if len(goals) == 1:
            goals *= len(signals)
        time = _required(one, "time", 1e-9, 1e9)
        amplitude, floor = _required(one, "amplitude", 0.0, 1e300), one.number("floor", 0.0, 0.0, 1e300)
        common = self._common(kind, one)
        if not math.isfinite(common[4]):
            common = (*common[:4], self._checked.start_time, common[5])
        return Convergence(*common, signals, tuple(goals), amplitude, time, floor)

    def _age(self, kind: str, one: Attributes) -> Monitor:
        most = _required(one, "most", 0.0, 1e9)
        common = self._common(kind, one)
        names = [] if self._network is None else [node.name for node in self._network.nodes]
        senders, receivers = (self._nodes(one, name, names) for name in ("from", "to"))
        exact = not is_pattern(one.text("from", "*") + one.text("to", "*"))
        pairs = [(a, b) for a in senders for b in receivers if a != b]
        if self._network is not None and self._network.topology == "listed":
            reached = heard_by_relays(self._network)
            heard = [(a, b) for a, b in pairs if reached[a, b]]
            if exact and len(heard) < len(pairs):
                a, b = next(pair for pair in pairs if pair not in heard)
                lacking = "the network has no <link> between them" + ", nor relays" * bool(self._network.relays)
                one.problem(f"{names[b]} cannot hear {names[a]}: {lacking}")
            pairs = heard
        if self._network is not None and senders and receivers and not pairs:
            one.problem("no node of `from` reaches another node of `to`")
        if len(pairs) > _MOST_PAIRS:
            one.problem(f"it watches {len(pairs)} pairs of nodes, more than {_MOST_PAIRS}: give fewer in from and to")
        return Age(*common, tuple(pairs), tuple(names), most)

    def _formula(self, kind: str, one: Attributes) -> Monitor:
        common = self._common(kind, one)
        written = one.text("text", "")
        signals: dict[str, tuple[Signal, ...]] = {}
        for child in one.children("signal")["signal"]:
            name = child.text("name", "")
            if not _NAME.fullmatch(name) or name == TIME or name in signals:
                child.problem(f'name="{name}" must be a word of its own, with letters, digits and _, and not {TIME}')
            signals[name] = self._named(child, "of", _quantity(child))
            child.finish()
        try:
            formula = parse(written)
            for _, node in formula.conjuncts:
                Evaluation(node, self._base)
        except FormulaError as error:
            one.problem(f'text="{written}": {error}')
            return FormulaMonitor(*common)
        except ValueError as error:
            one.problem(str(error))
            return FormulaMonitor(*common)
        for name in formula.signals:
            if name not in signals and name != TIME:
                one.problem(f'the formula uses "{name}", and no <signal> has this name; {near(name, (*signals, TIME))}')
        for name in signals.keys() - {*formula.signals}:
            one.problem(f'<signal name="{name}"> is not used by the formula')
        sizes = {name: len(of) for name, of in signals.items()}
        if len({size for size in sizes.values() if size > 1}) > 1:
            told = ", ".join(f"{name} matches {size}" for name, size in sizes.items())
            one.problem(f"its signals must be equally many, or one: {told}")
        return FormulaMonitor(*common, formula, signals)

    # ---- names ---------------------------------------------------------------------------------------------------

    def _bodies(self, one: Attributes, least: int) -> tuple[Signal, ...]:
        """Returns the positions of the vehicles that are named: by instance, or by the system that it is in."""
        if self._vehicles is None:
            self._vehicles = dict(_vehicles(self._checked))
        vehicles, groups = self._vehicles, {name.rpartition(".")[0] or name: name for name in self._vehicles}
        found: dict[str, None] = {}
        for pattern in one.text("vehicles", "*").split():
            names = [*matching(pattern, vehicles), *(groups[group] for group in matching(pattern, groups))]
            if not names:
                hint = near_pattern(pattern, (*groups, *vehicles))
                one.problem(f'vehicles: "{pattern}" matches no FMU with a position; {hint}')
                return ()
            found |= dict.fromkeys(names)
        if len(found) < least:
            one.problem(f"it needs at least {least} vehicles and has {len(found)} ({', '.join(found) or 'none'})")
        return tuple(signal for name, signal in vehicles.items() if name in found)

    def _named(self, one: Attributes, attribute: str, quantity: Quantity) -> tuple[Signal, ...]:
        """Returns the signals that match the patterns of an attribute, in the order of patterns and system."""
        if not self._scalars:
            self._scalars, self._arrays = _candidates(self._checked)
        known = self._scalars if quantity == "value" else self._arrays
        patterns = one.text(attribute, "").split()
        if not patterns:
            one.problem(f"it needs the attribute {attribute}")
        found: dict[str, Signal] = {}
        for pattern in patterns:
            names = matching(pattern, known)
            if not names:
                what = "output or local variable" if quantity == "value" else "array of reals"
                one.problem(f'{attribute}: "{pattern}" matches no {what}; {near_pattern(pattern, known)}')
            wrong = [name for name in names if quantity == "tilt" and len(known[name].variables) != 4]
            if wrong:
                size = len(known[wrong[0]].variables)
                one.problem(f"{attribute}: {wrong[0]} has {size} elements: the tilt is computed from a quaternion of 4")
            found |= {name: _as(known[name], quantity) for name in names}
        return tuple(found.values())

    def _nodes(self, one: Attributes, attribute: str, names: Sequence[str]) -> list[int]:
        found: dict[int, None] = {}
        number = {name: n for n, name in enumerate(names)}
        for pattern in one.text(attribute, "*").split():
            matched = matching(pattern, names)
            if not matched and self._network is not None:
                one.problem(f'{attribute}: "{pattern}" matches no node of the network; {near_pattern(pattern, names)}')
            found |= dict.fromkeys(number[name] for name in matched)
        return list(found)


def _as(signal: Signal, quantity: Quantity) -> Signal:
    return Signal(signal.name, signal.variables, "rad" if quantity == "tilt" else signal.unit, quantity)


def _quantity(one: Attributes) -> Quantity:
    return one.choice("quantity", "value", _QUANTITIES)  # type: ignore[return-value]


def _required(one: Attributes, name: str, low: float, high: float) -> float:
    value = one.optional(name, low, high)
    if value is None:
        one.problem(f"it needs the attribute {name}")
        return low
    return value


def _numbers(one: Attributes, name: str, default: str) -> list[float]:
    text = one.text(name, default)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        one.problem(f'{name}="{text}" must be numbers, separated by spaces')
        return []
    return values


def _vehicles(checked: CheckedSystem) -> Iterator[tuple[str, Signal]]:
    for instance in checked.instances:
        for name, verdict in instance.fmu.verdicts.items():
            if verdict is Role.POSITION:
                elements = elements_of(name, instance.fmu.variables)
                yield instance.name, Signal(instance.name, tuple((instance.name, one) for one in elements), "m")


def _candidates(checked: CheckedSystem) -> tuple[dict[str, Signal], dict[str, Signal]]:
    """Returns all numbers that a run can fetch, and all arrays of reals."""
    scalars: dict[str, Signal] = {}
    arrays: dict[str, Signal] = {}
    for instance in checked.instances:
        for name, v in instance.fmu.variables.items():
            if v.causality not in ("output", "local") or v.packet_capacity is not None or v.clock is not None:
                continue
            kind = set_kind(v)
            if kind not in ("Real", "Integer", "Boolean"):
                continue
            unit = "" if v.unit is None else v.unit.name
            scalars[f"{instance.name}.{name}"] = Signal(f"{instance.name}.{name}", ((instance.name, name),), unit)
            base, bracket, _ = name.partition("[")
            whole = f"{instance.name}.{base}"
            if kind == "Real" and bracket and whole not in arrays:
                elements = elements_of(base, instance.fmu.variables)
                if elements:
                    arrays[whole] = Signal(whole, tuple((instance.name, one) for one in elements), unit)
    return scalars, arrays
