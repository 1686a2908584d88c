"""The swarm as one federate of a HELICS federation: nodes as message endpoints, values, and time.

    federate = Federate(address, nodes, published, subscribed)   joins the federation
    federate.enter(interrupted)                                  waits until all federates begin
    federate.request(time, interrupted)                          waits until the federation is at this time
    federate.publish(values), .exchange(), .updates()            what is sent and received there

A message to another federate carries packets that one node has sent; a message to a node's endpoint carries packets for
the node. They cross as those of a gateway at a cable: each packet port of a node has a `Port`, which is a `Socket`.

Source: the C interface of HELICS 3.6 (github.com/GMLC-TDC/HELICS). It delivers a message that is sent for the present
time with the next grant. Waiting is done in Python, so that a run can be interrupted while another federate stands.
"""

from __future__ import annotations

import logging
import re
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from threading import Thread
from typing import Any
from uuid import uuid4

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where

__all__ = ["Federate", "FederationAddress", "FederationLost", "Port", "read_address"]

log = logging.getLogger(__name__)

_ADDRESS = re.compile(r"(?P<kind>\w+):(?:(?P<host>[^:,]*):)?(?P<port>\d+)")
_KINDS = ("zmq", "zmq_ss", "tcp", "tcp_ss")
"""Cores of HELICS that work between processes and lose nothing."""
_ANSWER = 10.0
"""Wall-clock time within which the broker must answer, s."""
_TIMES = ("period", "timeout")
_JOINING = "30s"
"""Within which the broker must have registered the federate, and answer when it leaves."""
_LEAVING = 3.0
"""Wall-clock time for leaving a federation that is lost, s."""
_TICK = "1s"
"""Intervals at which the core asks whether its broker still answers."""
_SPINS, _NAP = 200, 50e-6
_WHERE = Where("--helics")


class FederationLost(CosimError):
    """The federation has ended, or another federate has failed."""


@dataclass(frozen=True, slots=True)
class FederationAddress:
    """How the swarm takes part in a federation.

    Attributes:
        kind, host, port: core and broker.
        name: of the federate.
        period: time between two grants, s; None: the latency of the radio.
        timeout: wall-clock time within which others must begin, and then grant a time, s.
        to: the endpoint to which nodes send; "*": every other node; empty: they only receive.
    """

    kind: str
    host: str
    port: int
    name: str = "uav-cosim"
    period: float | None = None
    timeout: float = 60.0
    to: str = ""


def read_address(text: str) -> FederationAddress:
    """Reads ``KIND:[HOST:]PORT[,name=NAME][,period=S][,timeout=S][,to=ENDPOINT]``.

    Raises:
        SystemDescriptionError: it has another form.
    """
    head, *options = text.split(",")
    found = _ADDRESS.fullmatch(head)
    if found is None or found["kind"] not in _KINDS or not 0 < int(found["port"]) < 65536:
        wrong = f"{head}: write KIND:[HOST:]PORT of a broker; KIND is {', '.join(_KINDS)}"
        raise SystemDescriptionError([Problem(_WHERE, wrong)])
    given: dict[str, Any] = {}
    for option in options:
        name, _, value = option.partition("=")
        try:
            if name not in ("name", "period", "timeout", "to") or not value:
                raise ValueError("valid are name=, period=, timeout= and to=")
            given[name] = float(value) if name in _TIMES else value
            if name in _TIMES and not 0.0 < given[name] < 1e6:
                raise ValueError("must be a time in s")
        except ValueError as error:
            raise SystemDescriptionError([Problem(_WHERE, f"{option}: {error}")]) from None
    return FederationAddress(found["kind"], found["host"] or "127.0.0.1", int(found["port"]), **given)


class Port:
    """The packets of one packet port of a node on their way to and from the federation: a `Socket`."""

    stream, port = False, 0

    def __init__(self, node: str) -> None:
        self.node = node
        self.incoming: list[bytes] = []
        self.outgoing: list[bytes] = []

    def __str__(self) -> str:
        return f"HELICS endpoint {self.node}"

    def start(self) -> None: ...
    def close(self) -> None: ...

    def receive(self) -> list[bytes]:
        found, self.incoming = self.incoming, []
        return found

    def send(self, packets: Sequence[bytes]) -> int:
        self.outgoing += packets
        return len(packets)


def _await_broker(address: FederationAddress) -> None:
    """Waits until somebody listens at the broker's address; HELICS itself would take much longer to notice."""
    end = time.monotonic() + _ANSWER
    while True:
        try:
            socket.create_connection((address.host, address.port), _ANSWER).close()
        except OSError as error:
            if time.monotonic() > end:
                raise _unanswered(address, error) from None
            time.sleep(0.1)
        else:
            return


def _unanswered(address: FederationAddress, error: Exception) -> SystemDescriptionError:
    text = f"{address.kind}:{address.host}:{address.port}: {error}; is a broker of this kind running there?"
    return SystemDescriptionError([Problem(_WHERE, text)])


class Federate:
    """A federate that has joined a federation.

    Args:
        ports: the packet ports, each of which has an endpoint named after its node.
        published: signals and their units.
        subscribed: keys of publications of others.

    Raises:
        SystemDescriptionError: HELICS is not installed, no broker answers, or it refuses a name.
    """

    def __init__(
        self,
        address: FederationAddress,
        ports: Sequence[Port],
        published: Mapping[str, str],
        subscribed: Sequence[str],
    ) -> None:
        try:
            import helics
        except ImportError as error:
            text = f"a federation needs HELICS ({error}); pip install 'uav-cosim[helics]'"
            raise SystemDescriptionError([Problem(_WHERE, text)]) from None
        self._h: Any = helics
        self._address, self._ports, self._time = address, tuple(ports), 0.0
        self._subscribed = tuple(subscribed)
        self._ended = False
        self._unanswered: Callable[[Any], Any] | None = None
        if address.kind.startswith("zmq"):  # brokers of tcp take a visitor for a federate
            _await_broker(address)
        try:
            self._federate = self._joined(address)
            add = helics.helicsFederateRegisterGlobalEndpoint
            self._endpoints = {node: add(self._federate, node, "") for node in dict.fromkeys(p.node for p in ports)}
            double = helics.HELICS_DATA_TYPE_DOUBLE
            publish = helics.helicsFederateRegisterGlobalPublication
            self._published = [publish(self._federate, name, double, unit) for name, unit in published.items()]
            self._inputs = [helics.helicsFederateRegisterSubscription(self._federate, key, "") for key in subscribed]
        except helics.HelicsException as error:
            self.end(None)
            raise _unanswered(address, error) from None

    def _joined(self, address: FederationAddress) -> Any:
        h = self._h
        about = h.helicsCreateFederateInfo()
        h.helicsFederateInfoSetCoreTypeFromString(about, address.kind)
        h.helicsFederateInfoSetCoreName(about, f"{address.name}-{uuid4()}")
        broker = f"--federates=1 --broker_address=tcp://{address.host} --brokerport={address.port} --timeout={_JOINING}"
        broker += f" --tick={_TICK} --loglevel=error"
        h.helicsFederateInfoSetCoreInitString(about, broker)
        h.helicsFederateInfoSetFlagOption(about, h.HELICS_FLAG_UNINTERRUPTIBLE, True)
        h.helicsFederateInfoSetTimeProperty(about, h.HELICS_PROPERTY_TIME_DELTA, 1e-9)
        # It would print them on standard output. Errors are exceptions, and `_note_unknown` tells the rest.
        h.helicsFederateInfoSetIntegerProperty(about, h.HELICS_PROPERTY_INT_LOG_LEVEL, h.HELICS_LOG_LEVEL_NO_PRINT)
        return h.helicsCreateCombinationFederate(address.name, about)

    def enter(self, interrupted: Callable[[], bool]) -> bool:
        """Waits until all federates begin; returns whether they have, and not an interruption.

        Raises:
            FederationLost: the federation has ended.
        """
        h = self._h
        begin, complete = h.helicsFederateEnterExecutingModeAsync, h.helicsFederateEnterExecutingModeComplete
        if not self._awaited("begin", begin, complete, interrupted):
            return False
        self._note_unknown()
        return True

    def _note_unknown(self) -> None:
        """Notes endpoints and publications that no federate has: HELICS drops packets to them, and sends no values."""
        h = self._h
        asked = {"endpoints": {self._address.to} - {"", "*"}, "publications": {*self._subscribed}}
        for what, names in asked.items():
            if not names:
                continue
            try:
                known = h.helicsQueryExecute(h.helicsCreateQuery("root", what), self._federate)
            except h.HelicsException as error:
                raise FederationLost(f"the HELICS federation has failed: {error}") from None
            if not isinstance(known, list):  # an error, as HELICS tells it
                log.warning("note: HELICS does not tell the %s of the federation: %s", what, known)
                continue
            for name in sorted(names - {*known}):
                there = ", ".join(sorted(known)) or "none"
                log.warning("note: no federate has %s %s; %s of the federation: %s", what[:-1], name, what, there)

    def request(self, at: float, interrupted: Callable[[], bool]) -> bool:
        """Waits until the federation grants a time, s; returns whether it has, and not an interruption.

        Raises:
            FederationLost: the federation has ended, or granted another time.
        """
        if at <= self._time:
            return True
        h, granted = self._h, list[float]()

        def begin(federate: Any) -> None:
            h.helicsFederateRequestTimeAsync(federate, at)

        def complete(federate: Any) -> None:
            granted.append(h.helicsFederateRequestTimeComplete(federate))

        if not self._awaited(f"reach {at:g} s", begin, complete, interrupted):
            return False
        if abs(granted[0] - at) > 2e-9:
            raise FederationLost(f"the federation granted {granted[0]:g} s instead of {at:g} s: it has ended")
        self._time = at
        return True

    def _awaited(
        self, what: str, begin: Callable[[Any], Any], complete: Callable[[Any], Any], interrupted: Callable[[], bool]
    ) -> bool:
        h, spins, limit = self._h, 0, self._address.timeout
        end = time.monotonic() + limit
        try:
            begin(self._federate)
            self._unanswered = complete
            while not h.helicsFederateIsAsyncOperationCompleted(self._federate):
                spins += 1
                if spins > _SPINS:
                    time.sleep(_NAP)
                    if interrupted():
                        return False
                    if time.monotonic() > end:
                        text = f"the HELICS federation does not {what} within {limit:g} s: the broker or a federate"
                        raise FederationLost(f"{text} hangs or is missing; --helics ...,timeout=S waits longer")
            self._unanswered = None
            complete(self._federate)
        except h.HelicsException as error:
            raise FederationLost(f"the HELICS federation has failed: {error}") from None
        return True

    def publish(self, values: Sequence[float]) -> None:
        """Publishes the values of the signals."""
        for publication, value in zip(self._published, values, strict=True):
            self._h.helicsPublicationPublishDouble(publication, value)

    def exchange(self) -> None:
        """Sends the packets that nodes have sent, and hands over those that have arrived for nodes."""
        h = self._h
        for port in self._ports:
            packets, port.outgoing = port.outgoing, []
            own = self._endpoints[port.node]
            to = self._address.to
            receivers = [node for node in self._endpoints if node != port.node] if to == "*" else [to] if to else []
            for packet in packets:
                for receiver in receivers:
                    h.helicsEndpointSendBytesTo(own, packet, receiver)
        for node, endpoint in self._endpoints.items():
            while h.helicsEndpointHasMessage(endpoint):
                packet = bytes(h.helicsMessageGetBytes(h.helicsEndpointGetMessage(endpoint)))
                for port in self._ports:
                    if port.node == node:
                        port.incoming.append(packet)

    def updates(self) -> list[float | None]:
        """Returns the new value of each subscription; None: it has none."""
        h = self._h
        return [h.helicsInputGetDouble(one) if h.helicsInputIsUpdated(one) else None for one in self._inputs]

    def end(self, error: BaseException | None) -> None:
        """Leaves the federation; an error ends it for all. A broker that does not answer is not waited for."""
        if self._ended or not hasattr(self, "_federate"):
            return
        self._ended = True
        leaving = Thread(target=self._leave, args=(error,), daemon=True)
        leaving.start()
        leaving.join(_LEAVING if isinstance(error, FederationLost) else None)

    def _leave(self, error: BaseException | None) -> None:
        h = self._h
        with suppress(h.HelicsException):
            if self._unanswered is not None:  # only the core can take a question back
                h.helicsCoreDisconnect(h.helicsFederateGetCore(self._federate))
                self._unanswered(self._federate)
        with suppress(h.HelicsException):
            if self._unanswered is None and error is not None and not isinstance(error, FederationLost):
                h.helicsFederateGlobalError(self._federate, 1, f"{self._address.name}: {error}")
            h.helicsFederateDisconnect(self._federate)
        with suppress(h.HelicsException):
            h.helicsFederateFree(self._federate)
