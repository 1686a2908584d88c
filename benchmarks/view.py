"""The cost of the live page: processor time of `run --view` for line5 and for 1000 drones, with one page that draws.

The page is a process of its own, which acknowledges every picture as soon as it has it; a browser is slower. Processor
time is that of the run's own process only: of the observer (values, packets) in the thread of the run, and of the
server's thread. Both are measured by the clocks of their threads, so that other load on the machine does not count. The
share is that of the run without them. Without a number after the name, the run is as fast as possible.

    python benchmarks/view.py [line5 line5@1 1000] [--seconds 40] [--json FILE]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from report import machine, show, write

from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import View
from cosim_master.system.authoring.swarm.new import new_system
from cosim_master.view.live.document import known_of, live_document, live_traffic, shown
from cosim_master.view.live.feed import Feed
from cosim_master.view.live.parameters import Parameters
from cosim_master.view.live.sending import Sending
from cosim_master.view.live.server import LivePage

LINE5 = Path(__file__).resolve().parents[1] / "master" / "systems" / "line5"
READER = """
import json, math, struct, sys
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
address = sys.argv[1]
frames = size = 0
origin, socket = address.rsplit("/", 2)[0], address.replace("http:", "ws:") + "run"
with connect(socket, origin=origin, proxy=None, max_size=None) as run:
    print("open", flush=True)
    try:
        while True:
            message = run.recv()
            size += len(message)
            if isinstance(message, bytes) and not math.isnan(struct.unpack_from("<d", message)[0]):
                frames += 1
                run.send('{"do": "drawn"}')
    except ConnectionClosed:
        print(json.dumps([frames, size]))
"""


class Timed:
    """The live page of one run, and the processor time [s] that it takes."""

    def __init__(self, factor: float | None) -> None:
        self.control, self.mailbox, self.observer = Control(factor), Mailbox(), 0.0

    def make(self, view: View) -> Feed:
        self.feed = Feed(view)
        for name in ("packets", "progressed"):
            setattr(self.feed, name, self._timed(getattr(self.feed, name)))
        return self.feed

    def _timed(self, method: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any, **options: Any) -> None:
            before = time.thread_time()
            method(*arguments, **options)
            self.observer += time.thread_time() - before

        return call

    def begin(self, ready: Prepared) -> None:
        columns = shown(self.feed.columns, ready.checked)
        self.feed.show(columns)
        self.feed.traffic = live_traffic(columns, ready.checked, ready.network)
        document = live_document(columns, len(self.feed.columns), ready.checked, ready.network, ready.clock)
        sending = Sending(ready.network, known_of(ready.checked), self.feed.traffic, self.mailbox)
        parameters = Parameters(ready.checked, self.control)
        self.page = LivePage(document, self.feed, self.control, parameters, sending)
        self.reader = subprocess.Popen(
            [sys.executable, "-c", READER, self.page.address], stdout=subprocess.PIPE, text=True
        )
        assert self.reader.stdout is not None and self.reader.stdout.readline() == "open\n"
        self._clock = time.pthread_getcpuclockid(self.page._thread.ident)  # type: ignore[arg-type]
        self._before = time.clock_gettime(self._clock)

    @property
    def server(self) -> float:
        return time.clock_gettime(self._clock) - self._before


def measured(name: str, seconds: float) -> dict[str, Any]:
    """The cost of the page of one run; `name`: line5 or a number of drones, and @FACTOR of real time."""
    system, _, factor = name.partition("@")
    timed = Timed(float(factor) if factor else None)
    told: dict[str, Any] = {}

    def staged(stage: str) -> None:  # the recording is written after the last step
        if stage.startswith("writing"):
            told["server"], told["all"] = timed.server, time.process_time() - told["before"]

    def progress(_: Any) -> None:
        told.setdefault("before", time.process_time())

    with tempfile.TemporaryDirectory(prefix="uav-cosim-view-") as room:
        folder: Path = LINE5
        record: tuple[str, ...] = ()
        if system != "line5":
            folder, record = Path(room) / "system", ("*.vehicle.position*", "*.vehicle.attitude*")
            new_system("line", int(system), folder)
        result = simulate(
            folder,
            RunOptions(out=Path(room) / "out", until=seconds, record=record),
            observers=[timed.make],
            listener=Listener(prepared=timed.begin, stage=staged, progress=progress),
            control=timed.control,
            mailbox=timed.mailbox,
        )
        timed.page.end((f"ended: {result.outcome}", "good", ""))
        timed.page.close()
    frames, size = map(int, timed.reader.communicate()[0].strip("[]\n").split(","))
    own = timed.observer + told["server"]
    return {
        "run": name, "wall": result.wall_s, "factor": result.real_time_factor, "run_cpu": told["all"] - own,
        "observer": timed.observer, "server": told["server"], "share": own / (told["all"] - own),
        "of_a_core": own / result.wall_s, "frames": frames / result.wall_s, "rate": size / result.wall_s,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", default=["line5", "line5@1", "1000"])
    parser.add_argument("--seconds", type=float, default=40.0, help="simulated time of a run")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    host = machine("websockets")
    results = [measured(name, asked.seconds) for name in asked.runs]
    columns = ("run", "times real time", "run, s", "observer, s", "server, s", "share", "of a core", "frames/s", "kB/s")
    rows = [
        (
            one["run"], f"{one['factor']:.2f}",
            f"{one['run_cpu']:.2f}", f"{one['observer']:.3f}", f"{one['server']:.3f}",
            f"{one['share']:.1%}", f"{one['of_a_core']:.1%}", f"{one['frames']:.0f}", f"{one['rate'] / 1e3:.0f}",
        )
        for one in results
    ]  # fmt: skip
    show(
        "Live page", host, columns, rows, "seconds are of processor time; share: of the observer and server in the run"
    )
    write(asked.json, host, {"benchmark": "view", "rows": results})


if __name__ == "__main__":
    main()
