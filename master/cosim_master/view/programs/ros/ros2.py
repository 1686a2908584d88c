"""Topics of ROS 2 without ROS: topics of DDS whose names begin with "rt/"; Cyclone DDS writes and reads them.

DDS uses loopback only, without multicast, unless the variable CYCLONEDDS_URI configures it.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Mapping
from typing import Any

from cyclonedds.core import DDSException, Listener, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cosim_master.diagnostics.errors import CosimError
from cosim_master.view.programs.ros.ros2_types import TYPES

__all__ = ["Ros2"]

_LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>100</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery>"
    "</Domain></CycloneDDS>"
)
_HISTORY = Policy.History.KeepLast(10)
_QOS = Qos(Policy.Reliability.Reliable(duration(milliseconds=10)), _HISTORY)
"""ROS's usual quality of service; a reader that is slow loses messages, and the run waits 10 ms for it at most."""
_HEARD = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(100))
"""A reader that accepts writers of any quality, as MAVROS's readers of packets do."""


class Ros2:
    """The topics of a domain.

    Args:
        domain: its number (ROS_DOMAIN_ID).

    Attributes:
        types: classes of messages, by name.
    """

    types: Mapping[str, Any] = TYPES

    def __init__(self, domain: int) -> None:
        self._number = domain
        self._writers: dict[str, DataWriter[Any]] = {}
        self._readers: dict[str, DataReader[Any]] = {}
        self._news: deque[str] = deque()
        self._domain: Domain | None = None

    def open(self, published: Mapping[str, str], heard: Mapping[str, str]) -> None:
        """Opens the topics; both arguments map names to types.

        Raises:
            CosimError: DDS cannot open the domain.
        """
        try:
            # without a configuration of one's own, Cyclone DDS reads CYCLONEDDS_URI
            self._domain = None if os.environ.get("CYCLONEDDS_URI") else Domain(self._number, _LOOPBACK)
            participant = DomainParticipant(self._number)
            for name, kind in published.items():
                topic = Topic(participant, f"rt/{name}", TYPES[kind], qos=_QOS)
                self._writers[name] = DataWriter(participant, topic, qos=_QOS)
            for name, kind in heard.items():
                topic = Topic(participant, f"rt/{name}", TYPES[kind], qos=_HEARD)
                listener = _Noting(name, self._news)
                self._readers[name] = DataReader(participant, topic, qos=_HEARD, listener=listener)
        except DDSException as error:
            raise CosimError(f"--ros2 {self._number}: DDS cannot open this domain: {error}") from error

    def write(self, topic: str, message: Any) -> None:
        """Writes a message; it is lost if readers do not keep up."""
        try:
            self._writers[topic].write(message)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise

    def read(self) -> list[tuple[str, Any]]:
        """Returns the messages received since the last call, with their topics."""
        found = []
        while self._news:
            name = self._news.popleft()
            for message in self._readers[name].take(100):
                if message.sample_info.valid_data:
                    found.append((name, message))
        return found

    def close(self) -> None:
        """Closes the domain."""
        self._writers.clear()
        self._readers.clear()
        self._domain = None


class _Noting(Listener):
    """Notes the name of a topic when there are messages. Threads of DDS call it."""

    def __init__(self, name: str, news: deque[str]) -> None:
        self._name, self._news = name, news
        super().__init__()  # type: ignore[no-untyped-call]

    def on_data_available(self, reader: DataReader[Any]) -> None:  # noqa: ARG002
        self._news.append(self._name)
