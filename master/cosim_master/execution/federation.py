"""A run as one federate of a HELICS federation: it meets the others at equal intervals of simulated time.

At a meeting, the federation grants the time that the run has reached. Signals are published, packets of nodes are sent,
and the packets and values that others have sent before that time enter the run before its next step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import matching, near_pattern
from cosim_master.execution.execution import Execution
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.fmi.calls import KINDS
from cosim_master.fmi.description.read import Variable
from cosim_master.network.gateways.gateways import Gateways
from cosim_master.network.gateways.helics_federate import Federate, FederationAddress, Port, read_address
from cosim_master.stepping.control import Control
from cosim_master.stepping.layout import Layout
from cosim_master.system.settings.changes import Change, Changeable
from cosim_master.system.settings.network import Gateway, Network

__all__ = ["Federation", "Joining", "joining"]


@dataclass(frozen=True, slots=True)
class Joining:
    """How a run takes part in a federation.

    Attributes:
        address: of the federation.
        period: base steps between two meetings.
        gateways: one for each packet port of each node, at a cable of its own.
        published: instance and output of each published signal, by name.
        subscribed: the values that each key of the federation sets: numbers of instances, and variables.
    """

    address: FederationAddress
    period: int
    gateways: tuple[tuple[Gateway, Port], ...]
    published: Mapping[str, tuple[str, Variable]]
    subscribed: Mapping[str, Sequence[tuple[int, Variable]]]

    @property
    def observed(self) -> Collection[tuple[str, str]]:
        """The outputs that must be fetched."""
        return {(instance, variable.name) for instance, variable in self.published.values()}


def joining(ready: Prepared, text: str, publish: Sequence[str], subscribe: Sequence[str]) -> Joining:
    """Returns how a run takes part in the federation at an address.

    Args:
        text: the address, see `helics_federate.read_address`.
        publish: names or patterns of outputs.
        subscribe: ``VARIABLE=KEY``: inputs and tunable parameters that get the values of a publication.

    Raises:
        SystemDescriptionError: the address or a name is wrong; all problems of names are given.
    """
    address, problems = read_address(text), list[Problem]()
    outputs = {
        f"{instance.name}.{name}": (instance.name, variable)
        for instance in ready.checked.instances
        for name, variable in instance.fmu.variables.items()
        if variable.causality == "output" and variable.type in ("Real", "Integer", "Boolean", "Enumeration")
    }
    published: dict[str, tuple[str, Variable]] = {}
    for pattern in publish:
        found = matching(pattern, outputs)
        published |= {name: outputs[name] for name in found}
        if not found:
            problems.append(
                Problem(Where("--helics-publish"), f"{pattern}: no output; {near_pattern(pattern, outputs)}")
            )
    changeable, subscribed = Changeable(ready.checked), dict[str, list[tuple[int, Variable]]]()
    for one in subscribe:
        name, equals, key = one.partition("=")
        try:
            if not equals or not key:
                raise ValueError("write VARIABLE=KEY")
            for number, variable in changeable.matching(name):
                if variable.type != "Real":
                    raise ValueError(f"{variable.name} is {variable.type}; only Real variables can subscribe")
                subscribed.setdefault(key, []).append((number, variable))
        except ValueError as error:
            problems.append(Problem(Where("--helics-subscribe"), f"{one}: {error}"))
    if problems:
        raise SystemDescriptionError(problems)
    ports = tuple(
        (Gateway(f"@helics.{endpoint.name}", endpoint.name), Port(node.name))
        for node in ready.network.nodes
        for endpoint in node.endpoints
        if not endpoint.line
    )
    return Joining(address, _period(ready, address, ready.network), ports, published, subscribed)


def _period(ready: Prepared, address: FederationAddress, network: Network) -> int:
    base = ready.clock.seconds(1)
    if address.period is None:
        return max(1, math.floor(network.latency / base * (1 + 1e-12) + 1e-9))
    steps = round(address.period / base)
    if steps < 1 or not math.isclose(steps * base, address.period, rel_tol=1e-9):
        text = f"period={address.period:g} is not a multiple of the base step {base:.9g} s"
        raise SystemDescriptionError([Problem(Where("--helics"), text)])
    return steps


class Federation:
    """The federation of a run; a context manager that joins it, and leaves it.

    Attributes:
        error: the reason why the run has failed, which then ends the federation for all.
    """

    def __init__(self, how: Joining, layout: Layout) -> None:
        self.error: BaseException | None = None
        self._how, self._met = how, -1
        self._places: list[tuple[bool, int]] = []
        integers = len(layout.ports["Integer"].outputs)
        for instance, variable in how.published.values():
            kind = next(kind for kind in KINDS if (instance, variable.name) in layout.ports[kind].index)
            place = layout.ports[kind].index[instance, variable.name]
            self._places.append((kind == "Real", place + (integers if kind == "Boolean" else 0)))
        self._last: dict[str, float] = {}

    def __enter__(self) -> Self:
        ports = [port for _, port in self._how.gateways]
        units = {
            name: variable.unit.name if variable.unit else "" for name, (_, variable) in self._how.published.items()
        }
        self._federate = Federate(self._how.address, ports, units, [*self._how.subscribed])
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._federate.end(value or self.error)

    def before(self, k: int, stop: int) -> int:
        """Returns the base step up to which the run may go on from base step `k`: at most `stop`."""
        return min(stop, (k // self._how.period + 1) * self._how.period)

    def meet(self, execution: Execution, gateways: Gateways, control: Control, interrupted: Callable[[], bool]) -> None:
        """Meets the other federates, if a meeting is due at the present time.

        Raises:
            FederationLost: the federation has ended.
        """
        k = execution.k
        if k % self._how.period != 0 or k == self._met:
            return
        begun = self._met >= 0 or self._federate.enter(interrupted)
        if not begun or not self._federate.request(execution.clock.seconds(k), interrupted):
            return
        self._met = k
        plan = execution.plan
        self._federate.publish([float(plan.real_out[at] if real else plan.int_out[at]) for real, at in self._places])
        if gateways:
            gateways.exchange(execution)
        self._federate.exchange()
        for (key, targets), value in zip(self._how.subscribed.items(), self._federate.updates(), strict=True):
            if value is not None and self._last.get(key) != value:
                self._last[key] = value
                for number, variable in targets:
                    control.change(Change(k, number, variable, value))
        if gateways:
            gateways.exchange(execution)
