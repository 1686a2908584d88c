"""Gateways connect real programs to a run: packets enter and leave the network through sockets.

    --gcs udpout:127.0.0.1:14550            a radio node that hears every vehicle, for a ground station
    --ports tcp:5760+10,sign=key.txt        the serial port of every autopilot: vehicle n listens on 5760 + 10 (n - 1)

An autopilot may have packet ports that are reserved for ground stations or for a cable; it then uses these ports. Other
autopilots use the ports that lead to the rest of the swarm. An FMU is an autopilot if it declares that its motors may
turn (`cosim.verdict`), or if its component has the conventional name (`cosim.naming`).

An address is `KIND:[HOST:]PORT`. The kind is tcp (a server), udpin (listens) or udpout (sends first); the default host
is 127.0.0.1. Options may follow: `latency=`, `jitter=` (s) and `loss=` (0 to 1) of the link, and `sign=`, a file with a
key. With a key, outgoing packets are signed, and incoming packets must be signed.

`exchange` moves the available packets and never waits. No packet is lost silently: packets that do not cross are
counted, and the events of sockets are reported. Incoming packets are checked here, so only packets with a correct CRC
enter the network. The CRC of unknown messages, which routers forward, cannot be checked.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from cosim.naming import AUTOPILOT
from cosim.packets import BAD_CRC, INCOMPATIBLE, NOTHING, TRUNCATED, UNKNOWN, find, has_crc, message_id
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import ADDRESS
from cosim_master.files.xml import plain_number
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.network.gateways.signing import Signing, read_key
from cosim_master.network.gateways.sockets import KINDS, Socket, open_socket
from cosim_master.system.settings.network import Gateway, Network
from cosim_master.system.settings.radio.nodes import SERIAL, Endpoint, Node

if TYPE_CHECKING:
    from cosim.build.messages import Message
    from cosim_master.network.gateways.logs import LogRequests, WriteLog

__all__ = ["Address", "Air", "Gateways", "Parser", "autopilots_of", "gateways_of"]

_ADDRESS = re.compile(r"(?P<kind>\w+):(?:(?P<host>[^:,]*):)?(?P<port>\d+)(?:\+(?P<step>\d+))?")
_WAITING = 512
"""Packets of a gateway that may wait for each of their readers before reading from its socket is suspended."""


class Air(Protocol):
    """The side of a run that gateways exchange packets with; `Execution` is one."""

    @property
    def network(self) -> Network: ...

    @property
    def k(self) -> int:
        """The base step that the run has reached."""

    @property
    def entry(self) -> int:
        """The base step before which packets that are admitted now enter the network."""

    def admit(self, gateway: int, packets: Sequence[bytes]) -> None:
        """Admits packets that the gateway with this number received, at the current time."""

    def take(self, gateway: int) -> bytes:
        """Returns the packets that have arrived at a gateway since the last call, concatenated."""

    def waiting(self, gateway: int) -> int:
        """Returns the number of packets from a gateway that have not been read yet, counted once per reader."""


@dataclass(frozen=True, slots=True)
class Address:
    """The address of a gateway's socket, and the key for its signatures."""

    kind: str
    host: str
    port: int
    key: bytes | None = None

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


def gateways_of(
    network: Network, gcs: Sequence[str] = (), ports: str | None = None
) -> tuple[tuple[Gateway, Address], ...]:
    """Returns the gateways that the options `--gcs` and `--ports` request.

    Raises:
        SystemDescriptionError: an address is invalid, or no autopilot exists for a port; all problems are reported at
            once.
    """
    problems: list[Problem] = []
    made: list[tuple[Gateway, Address]] = []
    for i, text in enumerate(gcs):
        found = _read("--gcs", text, problems)
        if found is not None:
            link, address, step = found
            if step:
                problems.append(Problem(Where("--gcs"), f"{text}: +{step} is for --ports"))
            made.append((replace(link, name=f"@gcs{i + 1}" if i else "@gcs"), address))
    if ports is not None:
        found = _read("--ports", ports, problems)
        if found is not None:
            made += _ports(network, ports, *found, problems)
    taken = Counter((address.host, address.port) for _, address in made if address.port and address.kind != "udpout")
    for (host, port), times in taken.items():
        if times > 1 and not problems:
            problems.append(Problem(Where("--gcs, --ports"), f"{host}:{port} is asked for {times} times"))
    if problems:
        raise SystemDescriptionError(problems)
    return tuple(made)


def _ports(
    network: Network, text: str, link: Gateway, address: Address, step: int, problems: list[Problem]
) -> list[tuple[Gateway, Address]]:
    """Returns one gateway per autopilot, in the order of the nodes, named after its node if it is alone there."""
    where = Where("--ports")
    wired = []
    for node in network.nodes:
        autopilots = autopilots_of(node)
        for endpoint in autopilots:
            name = node.name if len(autopilots) == 1 else endpoint.instance
            lines = (e.name for e in node.lines if (e.instance, e.line) == (endpoint.instance, SERIAL))
            wired.append((name, next(lines, endpoint.name)))
    if not wired:
        names = ", ".join(e.instance for node in network.nodes for e in node.endpoints) or "none"
        how = f"an FMU declares to be one, or its component is called {AUTOPILOT}"
        text = f"no autopilot has packet ports: {how}; those that have are: {names}"
        problems.append(Problem(where, text))
    last = address.port + step * (len(wired) - 1)
    if len(wired) > 1 and step == 0 and address.port:
        problems.append(Problem(where, f"{text}: {len(wired)} vehicles need different ports, such as +10"))
    elif last > 65535:
        problems.append(Problem(where, f"{text}: the port of vehicle {len(wired)} would be {last}, above 65535"))
    return [
        (replace(link, name=f"@{node}", wired=instance), replace(address, port=address.port + step * i))
        for i, (node, instance) in enumerate(wired)
    ]


def autopilots_of(node: Node) -> list[Endpoint]:
    """Returns the endpoints of the FMUs that declare to be autopilots, or else of those with the conventional name."""
    both = [e for e in node.endpoints if e.rx is not None and e.tx is not None]
    declared = [e for e in both if e.instance in node.autopilots]
    return declared or [e for e in both if e.instance.rpartition(".")[2] == AUTOPILOT]


def _read(option: str, text: str, problems: list[Problem]) -> tuple[Gateway, Address, int] | None:
    """Returns the link, the address, and the difference between consecutive ports."""
    where = Where(option)
    head, *options = text.split(",")
    found = _ADDRESS.fullmatch(head)
    if found is not None and int(found["port"]) > 65535:
        problems.append(Problem(where, f"{head}: port {found['port']} is above 65535"))
        return None
    if found is None or found["kind"] not in KINDS:
        text = ADDRESS.text(head, ", ".join(KINDS))
        problems.append(Problem(where, text))
        return None
    numbers: dict[str, Any] = {}
    key = None
    for place, option in enumerate(options):
        name, _, value = option.partition("=")
        if name in [other.partition("=")[0] for other in options[:place]]:
            problems.append(Problem(where, f"{option}: {name} is given twice; leave out one of them"))
            continue
        try:
            if name == "sign":
                key = read_key(Path(value))
            elif name in ("latency", "jitter", "loss"):
                numbers[name] = _number(value, 1.0 if name == "loss" else 3600.0)
            else:
                problems.append(Problem(where, f"{option}: valid are latency=, jitter=, loss= and sign="))
        except OSError as error:
            problems.append(Problem(where, f"{option}: {error.strerror}"))
        except ValueError as error:
            problems.append(Problem(where, f"{option}: {error}"))
    address = Address(found["kind"], found["host"] or "127.0.0.1", int(found["port"]), key)
    return Gateway("", None, **numbers), address, int(found["step"] or 0)


def _number(text: str, high: float) -> float:
    try:
        value = plain_number(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= high:
        raise ValueError(f"must be a number from 0 to {high:g}")
    return value


class Parser:
    """Splits a byte stream into packets, and counts the bytes that do not belong to any packet.

    Args:
        stream: packets may span several pieces; otherwise every piece is a datagram, which ends with its last packet.
        dialect: messages that only this system defines.
    """

    def __init__(self, stream: bool, dialect: Sequence[Message] = ()) -> None:
        self.malformed = 0
        self._own = {message.id: message.crc_extra for message in dialect}
        self._stream = stream
        self._rest = b""

    def feed(self, piece: bytes) -> list[bytes]:
        """Returns the complete packets without CRC errors; b"" ends a stream."""
        data = self._rest + piece
        over = not self._stream or not piece
        buffer = np.frombuffer(data, np.uint8)
        packets = []
        p, n = 0, len(data)
        while p < n:
            start, stop, status = find(buffer, p, n)
            self.malformed += start > p
            if status == TRUNCATED:
                self.malformed += over
                p = n if over else start
                break
            if status != NOTHING:
                if status in (BAD_CRC, INCOMPATIBLE) or (status == UNKNOWN and self._is_wrong(buffer, start)):
                    self.malformed += 1
                else:
                    packets.append(data[start:stop])
            p = stop
        self._rest = data[p:]
        return packets

    def _is_wrong(self, buffer: NDArray[np.uint8], start: int) -> bool:
        extra = self._own.get(message_id(buffer, start))
        return extra is not None and not has_crc(buffer, start, extra)


class _Crossing:
    """One open gateway."""

    def __init__(
        self, gateway: Gateway, address: Address | Socket, report: Callable[[str], None], dialect: Sequence[Message]
    ) -> None:
        self.gateway, self.address = gateway, address
        self.counts: Counter[str] = Counter()
        self.socket: Socket
        self.signing: Signing | None = None
        if not isinstance(address, Address):
            self.socket = address
        else:
            self.socket = open_socket(address.kind, address.host, address.port, self._told(report))
            self.signing = Signing(address.key) if address.key is not None else None
        self.parser = Parser(self.socket.stream, dialect)
        self.logs: LogRequests | None = None

    def _told(self, report: Callable[[str], None]) -> Callable[[str], None]:
        def tell(what: str) -> None:
            self.counts["connections"] += what.endswith(("has connected", "is heard"))
            report(f"{self.gateway.name}: {what}")

        return tell

    def incoming(self) -> list[bytes]:
        packets = []
        for piece in self.socket.receive():
            packets += self.parser.feed(piece)
        self.counts["malformed"] = self.parser.malformed
        if self.signing is not None:
            refusals = [self.signing.refusal(packet) for packet in packets]
            self.counts.update(filter(None, refusals))
            packets = [packet for packet, refusal in zip(packets, refusals, strict=True) if not refusal]
        self.counts["received"] += len(packets)
        return packets if self.logs is None else self.logs.take(packets)

    def outgoing(self, block: bytes) -> None:
        packets = Parser(stream=False).feed(block)
        if self.logs is not None:
            self.logs.hear(packets)
            packets += self.logs.answers()
        if self.signing is not None:
            packets = [self.signing.sign(packet) for packet in packets]
        taken = self.socket.send(packets)
        self.counts["sent"] += taken
        self.counts["not taken"] += len(packets) - taken


class Gateways:
    """The open gateways of a run; a context manager that closes them.

    Args:
        asked: the result of `gateways_of`, and gateways with ends in this process (`Mailbox`, `Port`).
        report: called with messages about sockets.
        dialect: messages that only this system defines.

    Raises:
        SystemDescriptionError: sockets cannot be opened; all of them are reported at once.
    """

    def __init__(
        self,
        asked: Sequence[tuple[Gateway, Address | Socket]],
        report: Callable[[str], None],
        dialect: Sequence[Message] = (),
    ) -> None:
        self._open: list[_Crossing] = []
        self._thread: ThreadPoolExecutor | None = None
        problems = []
        for gateway, address in asked:
            try:
                self._open.append(_Crossing(gateway, address, report, dialect))
            except OSError as error:
                where = Where("--ports" if gateway.wired else "--gcs")
                problems.append(Problem(where, f"{address} cannot be opened: {error.strerror or error}"))
        if problems:
            self.close()
            raise SystemDescriptionError(problems)

    def __bool__(self) -> bool:
        return bool(self._open)

    @property
    def to_programs(self) -> bool:
        """Whether real programs may be connected, which expect answers in short time."""
        return any(not isinstance(one.address, Mailbox) for one in self._open)

    def start(self) -> None:
        """Accepts connections from real programs from now on."""
        for one in self._open:
            one.socket.start()

    def serve_logs(self, write: WriteLog) -> None:
        """Answers requests for logs in place of the autopilots from now on; `write` is called in a thread."""
        stations = [one for one in self._open if not isinstance(one.address, Mailbox)]
        if not stations:
            return
        from cosim_master.network.gateways.logs import LogRequests  # and all messages of MAVLink

        self._thread = ThreadPoolExecutor(1)
        for one in stations:
            one.logs = LogRequests(write, self._thread)

    def exchange(self, air: Air) -> None:
        """Admits the packets that the sockets have received, and sends those that have arrived at the gateways."""
        for g, crossing in enumerate(self._open):
            mailbox = crossing.address if isinstance(crossing.address, Mailbox) else None
            if mailbox is not None:
                mailbox.reach(air.k)
            readers = 1 if crossing.gateway.wired else max(1, len(air.network.nodes))
            if air.waiting(g) > _WAITING * readers:
                crossing.counts["held back"] += 1  # they remain in the socket: TCP clients will wait
            else:
                packets = crossing.incoming()
                if mailbox is not None:
                    mailbox.admitted += [(air.entry, packet) for packet in packets]
                air.admit(g, packets)
            crossing.outgoing(air.take(g))

    def before(self, stop: int) -> int:
        """Returns the base step up to which the run may go on: `stop`, or that at which a known packet enters."""
        return min((one.address.before(stop) for one in self._open if isinstance(one.address, Mailbox)), default=stop)

    def counts(self) -> dict[str, dict[str, int | str]]:
        """Returns, by gateway, the numbers of packets carried and refused, of connections, and of times held back.

        A quiet gateway is left out if nothing has crossed it.
        """
        return {
            one.gateway.name: {"address": str(one.address), **{name: n for name, n in one.counts.items() if n}}
            for one in self._open
            if not one.gateway.quiet or any(one.counts.values())
        }

    def close(self) -> None:
        """Closes all sockets."""
        for crossing in self._open:
            crossing.socket.close()
        self._open.clear()
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
