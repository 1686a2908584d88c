"""A swarm in a HELICS federation: a second federate on loopback hears it, sets values, and carries its packets."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways import helics_federate
from cosim_master.network.gateways.helics_federate import Federate, Port, read_address
from cosim_master.stepping.control import Control
from tests.master.forks import Forks
from tests.master.parts import run_in_parts
from tests.scenarios.flights import SYSTEMS, copy_of, fly

helics = pytest.importorskip("helics")

LINE5 = SYSTEMS / "line5"
PERIOD = 0.02
"""The radio's latency of line5, at which the swarm meets others."""


def never() -> bool:
    return False


def free_port() -> int:
    """A port that is free, as is the next, which brokers of kind zmq take, too.

    Ports above these are given to clients: another test's connection could have it when the broker begins.
    """
    for port in random.SystemRandom().sample(range(20_000, 32_000), 1000):
        try:
            for one in (port, port + 1):
                with socket.socket() as found:
                    found.bind(("127.0.0.1", one))
        except OSError:
            continue
        return port
    raise AssertionError("no two ports in a row are free")


@contextmanager
def brokered(kind: str, federates: int) -> Iterator[str]:
    """The address of a broker for so many federates."""
    port = free_port()
    broker = helics.helicsCreateBroker(
        kind, "", f"-f {federates} --localport={port} --local_interface=127.0.0.1 --loglevel=error"
    )
    assert helics.helicsBrokerIsConnected(broker)
    try:
        yield f"{kind}:{port}"
    finally:
        helics.helicsBrokerDisconnect(broker)
        helics.helicsBrokerFree(broker)


class Other:
    """The second federate, written with the functions of HELICS alone: it is granted every period."""

    def __init__(self, address: str, meet: Callable[[Other, int], None], periods: int) -> None:
        kind, port = address.split(":")
        about = helics.helicsCreateFederateInfo()
        helics.helicsFederateInfoSetCoreTypeFromString(about, kind)
        core = f"--broker_address=tcp://127.0.0.1 --brokerport={port} --tick=1s --timeout=3s --loglevel=error"
        helics.helicsFederateInfoSetCoreInitString(about, core)
        helics.helicsFederateInfoSetFlagOption(about, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
        self.federate = helics.helicsCreateCombinationFederate("other", about)
        double = helics.HELICS_DATA_TYPE_DOUBLE
        self.east = helics.helicsFederateRegisterGlobalPublication(self.federate, "weather/east", double, "m/s")
        self.radio = helics.helicsFederateRegisterGlobalEndpoint(self.federate, "radio", "")
        self.position = helics.helicsFederateRegisterSubscription(self.federate, "drone3.vehicle.position[2]", "m")
        self.messages: list[tuple[str, bytes]] = []
        self.errors: list[BaseException] = []
        self._meet, self._periods = meet, periods
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            helics.helicsFederateEnterExecutingMode(self.federate)
            for k in range(1, self._periods + 1):
                helics.helicsFederateRequestTime(self.federate, k * PERIOD)
                while helics.helicsEndpointHasMessage(self.radio):
                    self.messages.append(self._next())
                self._meet(self, k)
            helics.helicsFederateDisconnect(self.federate)
        except BaseException as error:
            self.errors.append(error)

    def _next(self) -> tuple[str, bytes]:
        """Returns source and packet of the next message.

        The message itself does not outlive this: HELICS reuses its memory, and freeing it later would free another one.
        """
        message = helics.helicsEndpointGetMessage(self.radio)
        return helics.helicsMessageGetSource(message), bytes(helics.helicsMessageGetBytes(message))

    def join(self) -> None:
        self.thread.join(300)
        assert not self.thread.is_alive()
        assert self.errors == []


def rows(out: Path) -> Any:
    return pq.read_table(out / "signals.parquet")


@pytest.mark.parametrize("kind", ["zmq", "tcp_ss"])
def test_values_go_both_ways(fmus: Path, tmp_path: Path, kind: str) -> None:
    """The other federate's wind has the effect of the same --at, and what it hears is what was recorded."""
    heard: dict[float, float] = {}

    def meet(other: Other, k: int) -> None:
        heard[round((k - 1) * PERIOD, 9)] = helics.helicsInputGetDouble(other.position)
        helics.helicsPublicationPublishDouble(other.east, 0.5 * (k // 50))

    control = Control()
    with brokered(kind, 2) as address:
        other = Other(address, meet, 400)
        options = RunOptions(
            out=tmp_path / "out",
            until=8.0,
            helics=address,
            helics_publish=["drone3.vehicle.position*"],
            helics_subscribe=["drone3.vehicle.wind[2]=weather/east"],
        )
        result = simulate(LINE5, options, control=control)
        other.join()
    assert result.outcome == "done", result.error
    assert len(control.made) == 8
    at = [(time, "drone3.vehicle.wind[2]", str(change.value)) for time, change in control.made if time is not None]
    whole = fly(LINE5, tmp_path / "whole", until=8.0, at=at)
    assert rows(tmp_path / "out").equals(rows(whole.folder))
    assert not rows(fly(LINE5, tmp_path / "calm", until=8.0).folder).equals(rows(whole.folder))
    recorded = rows(tmp_path / "out")
    wanted = dict(zip(recorded["time"].to_pylist(), recorded["drone3.vehicle.position[2]"].to_pylist(), strict=True))
    compared = [time for time in heard if round(time / 0.1, 6).is_integer() and time > 0.0]
    assert len(compared) == 79
    assert all(heard[time] == wanted[min(wanted, key=lambda one, t=time: abs(one - t))] for time in compared)


def test_messages_go_to_nodes_and_from_them(fmus: Path, tmp_path: Path) -> None:
    speaker = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
    ask = mavlink.MAVLink_command_long_message(
        4, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0
    )

    def meet(other: Other, k: int) -> None:
        if k == 40:
            helics.helicsEndpointSendBytesTo(other.radio, bytes(ask.pack(speaker)), "drone4")

    with brokered("zmq", 2) as address:
        other = Other(address, meet, 100)
        result = simulate(LINE5, RunOptions(out=tmp_path / "out", until=2.0, helics=f"{address},to=radio"))
        other.join()
    assert result.outcome == "done", result.error
    assert {source for source, _ in other.messages} == {f"drone{i}" for i in range(1, 6)}
    found = [(source, mavlink.MAVLink(None).parse_buffer(packet)[0]) for source, packet in other.messages]
    answers = [(source, one.result) for source, one in found if one.get_type() == "COMMAND_ACK"]
    assert answers == [("drone4", mavlink.MAV_RESULT_ACCEPTED)]
    assert result.gateways["@helics.drone4.autopilot"]["received"] == 1


def test_the_federation_replaces_the_radio(fmus: Path, tmp_path: Path) -> None:
    """Without links, nodes hear each other only through the federation; each packet goes to the four others."""

    def unlinked(text: str) -> str:
        new = '<network xmlns="https://uav-cosim.org/ns/1" topology="listed"/>'
        return re.sub(r"<network [^>]*/>", new, text)

    system = copy_of("line5", tmp_path, fmus, unlinked)
    with brokered("zmq", 1) as address:
        result = simulate(system, RunOptions(out=tmp_path / "out", until=2.0, helics=f"{address},to=*,period=0.05"))
    assert result.outcome == "done", result.error
    counts = result.gateways.values()
    sent, received = (sum(int(one.get(name, 0)) for one in counts) for name in ("sent", "received"))
    ports = 2  # of each node: autopilot and agent, both of which get its messages
    assert sent > 20
    assert 0 <= 4 * ports * sent - received <= 4 * ports * 5  # the last ones are under way


def test_a_federate_that_fails_ends_the_run(fmus: Path, tmp_path: Path) -> None:
    def meet(other: Other, k: int) -> None:
        if k == 20:
            helics.helicsFederateGlobalError(other.federate, 7, "the grid has collapsed")

    with brokered("zmq", 2) as address:
        other = Other(address, meet, 1000)
        result = simulate(LINE5, RunOptions(out=tmp_path / "out", until=30.0, helics=address))
        other.thread.join(300)
    assert result.outcome == "failed"
    assert "federation" in str(result.error)
    times = rows(tmp_path / "out")["time"].to_pylist()
    assert times[0] == 0.0
    assert 0.3 < times[-1] <= result.simulated_s < 1.0


def test_a_run_that_waits_for_the_federation_can_be_interrupted() -> None:
    with brokered("zmq", 2) as address:
        own = Federate(read_address(address), [Port("drone1")], {"x": "m"}, ["y"])
        calls = []

        def interrupted() -> bool:
            calls.append(1)
            return len(calls) > 20

        assert own.enter(interrupted) is False  # the second federate does not come
        own.end(None)


def test_without_a_broker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helics_federate, "_ANSWER", 0.5)
    with pytest.raises(SystemDescriptionError, match=r"--helics: zmq:127\.0\.0\.1:\d+: .*is a broker of this kind"):
        simulate(LINE5, RunOptions(until=1.0, helics=f"zmq:{free_port()}"))


def test_without_helics(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "helics", None)
    with pytest.raises(SystemDescriptionError, match=r"a federation needs HELICS .*pip install 'uav-cosim\[helics\]'"):
        simulate(LINE5, RunOptions(until=1.0, helics="zmq:1"))


BROKER = """
import helics, sys
text = f"-f 2 --localport={sys.argv[1]} --local_interface=127.0.0.1 --loglevel=error"
broker = helics.helicsCreateBroker("tcp_ss", "", text)
print(helics.helicsBrokerIsConnected(broker), flush=True)
helics.helicsBrokerWaitForDisconnect(broker, -1)
"""
OTHER = """
import helics, os, sys, time
port, broker, number = map(int, sys.argv[1:])
about = helics.helicsCreateFederateInfo()
helics.helicsFederateInfoSetCoreTypeFromString(about, "tcp_ss")
text = f"--broker_address=tcp://127.0.0.1 --brokerport={port} --loglevel=error"
helics.helicsFederateInfoSetCoreInitString(about, text)
helics.helicsFederateInfoSetFlagOption(about, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
federate = helics.helicsCreateCombinationFederate("other", about)
helics.helicsFederateRegisterGlobalEndpoint(federate, "radio", "")
helics.helicsFederateEnterExecutingMode(federate)
for k in range(1, 41):
    helics.helicsFederateRequestTime(federate, k * 0.02)
os.kill(broker, number)
time.sleep(600)
"""


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (signal.SIGKILL, "HELICS federation"),
        (signal.SIGSTOP, "the HELICS federation does not reach [0-9.]+ s within 5 s: the broker or a federate hangs"),
    ],
    ids=["killed", "stopped"],
)
def test_a_broker_that_ends_the_run(fmus: Path, tmp_path: Path, forks: Forks, number: int, text: str) -> None:
    """Broker, swarm and second federate are processes; what was recorded until then is complete."""
    port, python = free_port(), [sys.executable, "-c"]
    command = ["run", str(LINE5), "-o", str(tmp_path / "out"), "--until", "30", "--helics", f"tcp_ss:{port},timeout=5"]
    with subprocess.Popen([*python, BROKER, str(port)], stdout=subprocess.PIPE, text=True) as broker:
        assert broker.stdout is not None
        assert broker.stdout.readline() == "True\n"
        with subprocess.Popen(
            [*python, OTHER, str(port), str(broker.pid), str(number)], stderr=subprocess.PIPE
        ) as other:
            done = forks.run(command, tmp_path, os.environ)
            other.kill()
        broker.kill()
    assert done.returncode == 1
    assert re.search(text, done.stderr)
    simulated = json.loads((tmp_path / "out" / "manifest.json").read_text())["simulated_s"]
    times = rows(tmp_path / "out")["time"].to_pylist()
    assert 0.7 < times[-1] <= simulated < 1.0


def test_endpoints_and_publications_that_nobody_has_are_noted(fmus: Path, tmp_path: Path, forks: Forks) -> None:
    """HELICS itself would write a line on standard output for each packet, where a program expects JSON."""
    with brokered("zmq", 1) as address:
        command = ["run", str(LINE5), "-o", str(tmp_path / "out"), "--until", "0.5", "--json"]
        command += ["--helics", f"{address},to=nix", "--helics-subscribe", "drone3.vehicle.wind[2]=nothing"]
        done = forks.run(command, tmp_path, os.environ)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["outcome"] == "done"
    nodes = ", ".join(f"drone{n}" for n in range(1, 6))
    assert f"note: no federate has endpoint nix; endpoints of the federation: {nodes}" in done.stderr
    assert "note: no federate has publication nothing; publications of the federation: none" in done.stderr


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"helics": "udp:23404"}, r"udp:23404: write KIND:\[HOST:\]PORT of a broker; KIND is zmq, zmq_ss, tcp, tcp_ss"),
        ({"helics": "zmq:99999"}, "zmq:99999: write KIND"),
        ({"helics": "zmq:1,speed=2"}, "speed=2: valid are name=, period=, timeout= and to="),
        ({"helics": "zmq:1,period=x"}, "period=x: could not convert"),
        ({"helics": "zmq:1,period=0.0031"}, r"period=0.0031 is not a multiple of the base step 0.0025 s"),
        ({"helics": "zmq:1", "helics_publish": ["drone1.vehicle.positon*"]}, r"positon\*: no output; "),
        ({"helics": "zmq:1", "helics_subscribe": ["drone1.vehicle.wind[1]"]}, "write VARIABLE=KEY"),
        ({"helics": "zmq:1", "helics_subscribe": ["drone1.vehicle.mass=k"]}, "only tunable parameters and inputs"),
        ({"helics_publish": ["x"]}, "--helics-publish: it belongs to --helics, which is not given"),
        ({"helics": "zmq:1", "checkpoint_every": 1.0}, "a run in a federation has no checkpoints"),
    ],
)
def test_wrong_options(fmus: Path, tmp_path: Path, options: dict[str, Any], text: str) -> None:
    with pytest.raises(SystemDescriptionError, match=text):
        simulate(LINE5, RunOptions(out=tmp_path / "out", **options))


def test_parts_take_no_part_in_a_federation(fmus: Path) -> None:
    with pytest.raises(SystemDescriptionError, match="--helics: others would meet parts that"):
        run_in_parts(LINE5, RunOptions(helics="zmq:1"), 2)


def test_the_example_of_the_guide(fmus: Path, tmp_path: Path, forks: Forks) -> None:
    """The program and the command of docs/helics.md, as they are printed, at another port."""
    text = (SYSTEMS.parents[1] / "docs" / "helics.md").read_text(encoding="utf-8").replace("23404", str(free_port()))
    (program,) = re.findall(r"^```python weather.py\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    (command,) = re.findall(r"^```sh helics\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    (tmp_path / "weather.py").write_text(program, encoding="utf-8")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    with subprocess.Popen([sys.executable, "weather.py"], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as weather:
        done = forks.shell(command.replace("\\\n", ""), tmp_path, {**os.environ, "PATH": path})
        said, _ = weather.communicate(timeout=300)
    assert done.returncode == 0, done.stderr
    found = re.search(r"drone 3 is at ([0-9.]+) m east; ([0-9]+) packets", said)
    assert found is not None
    recorded = rows(tmp_path / "out" / "federated")["drone3.vehicle.position[2]"].to_pylist()
    assert min(abs(value - float(found[1])) for value in recorded[-20:]) < 0.01
    assert int(found[2]) > 100
