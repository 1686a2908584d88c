"""Two models of ours speak a dialect of their own: its XML file makes their module, and the network routes it."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim.build import build
from cosim_master.cli import app
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate

XML = """<?xml version="1.0"?>
<mavlink>
  <include>common.xml</include>
  <messages>
    <message id="42101" name="AUCTION_BID">
      <description>What a drone bids for a task.</description>
      <field type="uint8_t" name="target_system">whom it is for</field>
      <field type="uint16_t" name="task">number of the task</field>
      <field type="double" name="price">lower is better</field>
    </message>
    <message id="42102" name="AUCTION_OPEN">
      <description>An auctioneer is there.</description>
      <field type="uint16_t" name="tasks">how many there are</field>
    </message>
  </messages>
</mavlink>
"""

MODELS = '''
"""A bidder sends AUCTION_BIDs, an auctioneer keeps the last."""
from __future__ import annotations
from typing import Any
from cosim import Memory, Model, Output, PacketInput, PacketOutput, Parameter, kernel
from cosim.packets import NOTHING, TRUNCATED, UNKNOWN, find, unpack
from auction.messages import (
    decode_auction_bid, encode_auction_bid, encode_auction_open, is_auction_bid, pack_auction_bid, pack_auction_open
)

@kernel
def begin(m: Any) -> int:
    return 0

@kernel
def bid(m: Any, t: float, h: float) -> int:
    encode_auction_bid(m.payload, m.target, 7, 100.0 + m.sent)
    m.mavlink_tx_len = pack_auction_bid(m.mavlink_tx, 0, m.payload, m.sent % 256, m.sysid, 191)
    m.sent += 1
    return 0

@kernel
def listen(m: Any, t: float, h: float) -> int:
    encode_auction_open(m.payload, 9)
    m.mavlink_tx_len = pack_auction_open(m.mavlink_tx, 0, m.payload, 0, m.sysid, 191)
    p = 0
    while True:
        start, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
        if status in (NOTHING, TRUNCATED):
            return 0
        if status == UNKNOWN and is_auction_bid(m.mavlink_rx, start):
            unpack(m.mavlink_rx, start, m.payload)
            _, m.task, m.price = decode_auction_bid(m.payload)
            m.heard += 1

class Bidder(Model):
    """Bids at every step."""
    step_size = 0.01
    variables = (
        Parameter("sysid", type=int, start=1, description="its MAVLink system id"),
        Parameter("target", type=int, start=2, description="to whom"),
        Output("sent", type=int, start=0, description="bids so far"),
        Memory("payload", dtype="u1", shape=255),
        PacketInput("mavlink_rx", capacity=1024, description="not read"),
        PacketOutput("mavlink_tx", capacity=300, description="bids"),
    )
    kernels = (begin, bid)

class Auctioneer(Model):
    """Keeps the last bid."""
    step_size = 0.01
    variables = (
        Parameter("sysid", type=int, start=2, description="its MAVLink system id"),
        PacketInput("mavlink_rx", capacity=1024, description="bids"),
        Output("heard", type=int, start=0, description="bids so far"),
        Output("task", type=int, start=0, description="of the last"),
        Output("price", unit="1", start=0.0, description="of the last"),
        Memory("payload", dtype="u1", shape=255),
        PacketOutput("mavlink_tx", capacity=64, description="that it is there"),
    )
    kernels = (begin, listen)
'''

SYSTEM = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="auction" version="1.0">
  <ssd:System name="auction">
    <ssd:Elements>
      <ssd:Component name="bidder" type="application/x-fmu-sharedlibrary" source="Bidder.fmu"/>
      <ssd:Component name="auctioneer" type="application/x-fmu-sharedlibrary" source="Auctioneer.fmu"/>
      <ssd:Component name="bystander" type="application/x-fmu-sharedlibrary" source="Auctioneer.fmu">
        <ssd:ParameterBindings>
          <ssd:ParameterBinding>
            <ssd:ParameterValues>
              <ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0"
                  name="bystander">
                <ssv:Parameters>
                  <ssv:Parameter name="sysid"><ssv:Integer value="3"/></ssv:Parameter>
                </ssv:Parameters>
              </ssv:ParameterSet>
            </ssd:ParameterValues>
          </ssd:ParameterBinding>
        </ssd:ParameterBindings>
      </ssd:Component>
    </ssd:Elements>
    <ssd:Annotations>
      <ssc:Annotation type="org.uav-cosim.network">
        <network xmlns="https://uav-cosim.org/ns/1" latency="0.02" seed="1" {dialect}/>
      </ssc:Annotation>
    </ssd:Annotations>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1"/>
</ssd:SystemStructureDescription>
"""


@pytest.fixture(scope="module")
def auction(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the dialect, the module generated from it, and the FMUs of the models that use it."""
    folder = tmp_path_factory.mktemp("auction")
    package = folder / "auction"
    package.mkdir()
    (package / "__init__.py").touch()
    (folder / "auction.xml").write_text(XML)
    (package / "models.py").write_text(MODELS)
    written = CliRunner().invoke(app, ["dialect", str(folder / "auction.xml"), "-o", str(package / "messages.py")])
    assert written.exit_code == 0, written.output
    assert "AUCTION_BID" in written.output
    sys.path.insert(0, str(folder))
    try:
        models: ModuleType = importlib.import_module("auction.models")
        for name in ("Bidder", "Auctioneer"):
            built = build(getattr(models, name), folder)
            assert built.compiled
        yield folder
    finally:
        sys.path.remove(str(folder))
        for name in [name for name in sys.modules if name.partition(".")[0] == "auction"]:
            del sys.modules[name]


def run(folder: Path, out: Path, dialect: str) -> tuple[RunResult, dict[str, np.ndarray]]:
    (folder / "SystemStructure.ssd").write_text(SYSTEM.format(dialect=dialect))
    result = simulate(folder, RunOptions(out=out))
    table = pq.read_table(out / "signals.parquet")
    return result, {name: table[name].to_numpy() for name in table.column_names}


def test_bids_reach_whom_they_are_for(auction: Path, tmp_path: Path) -> None:
    result, signals = run(auction, tmp_path / "out", 'dialect="auction.xml"')
    assert result.outcome == "done"
    sent, heard = int(signals["bidder.sent"][-1]), int(signals["auctioneer.heard"][-1])
    assert sent == 100
    assert heard == 97  # the last are 20 ms and a step under way
    assert signals["auctioneer.task"][-1] == 7
    assert signals["auctioneer.price"][-1] == 100.0 + 96
    rises = np.diff(signals["auctioneer.price"])
    assert sorted(rises[rises > 0])[: heard - 1] == [1.0] * (heard - 1)
    assert signals["bystander.heard"][-1] == 0


def test_without_the_dialect_bids_are_of_an_unknown_message(auction: Path, tmp_path: Path) -> None:
    """A router forwards what it does not know to everybody: it cannot tell whom it is for."""
    _, signals = run(auction, tmp_path / "out", "")
    assert signals["bystander.heard"][-1] == signals["auctioneer.heard"][-1] == 97
