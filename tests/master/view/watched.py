"""A run of `line5` with a live page, which stands still until its reader lets it go on."""

from __future__ import annotations

import struct
import threading
import time
from pathlib import Path
from typing import Any

from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.simulate import simulate
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import View
from cosim_master.verdict.findings import Judgement
from cosim_master.view.live.document import drones_of, known_of, live_document, live_traffic, shown
from cosim_master.view.live.feed import Feed
from cosim_master.view.live.parameters import Parameters, unchangeable
from cosim_master.view.live.sending import Sending
from cosim_master.view.live.server import LivePage
from cosim_master.view.replay import told_verdict

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"


class Standing(Control):
    """Says whether the run stands still: it does when it has waited twice since the pause."""

    waits = 0

    def pause(self) -> None:
        self.waits = 0
        super().pause()

    def wait(self, seconds: float) -> None:
        self.waits += 1
        super().wait(seconds)


class Watched:
    """What the verb does, with a reader who is there from the beginning."""

    def __init__(self) -> None:
        self.control = Standing()
        self.control.pause()
        self.mailbox = Mailbox()
        self.begun = threading.Event()

    def run(self, out: Path, until: float, **options: Any) -> RunResult:
        result = simulate(
            LINE5,
            RunOptions(out=out, until=until, **options),
            observers=[self._observer],
            listener=Listener(prepared=self._prepared, judged=self._judged),
            control=self.control,
            mailbox=self.mailbox,
        )
        assert result.verdict is not None
        self._judged(result.verdict)
        self.page.end((f"ended: {result.outcome}", "good", ""))
        return result

    def standing(self) -> float:
        """The time at which the paused run stands still, s."""
        while not (self.control.paused and self.control.waits >= 2):
            time.sleep(0.01)
        found: float = struct.unpack_from("<d", self.feed.newest[1])[0]
        return found

    def _observer(self, view: View) -> Feed:
        self.feed = Feed(view)
        return self.feed

    def _judged(self, verdict: Judgement) -> None:
        self.feed.verdict = told_verdict(verdict.as_json(), self.drones)

    def _prepared(self, ready: Prepared) -> None:
        columns = shown(self.feed.columns, ready.checked)
        self.feed.show(columns)
        self.drones = drones_of(columns, ready.checked)
        self.feed.traffic = live_traffic(columns, ready.checked, ready.network)
        self.document = live_document(columns, len(self.feed.columns), ready.checked, ready.network, ready.clock)
        parameters = Parameters(ready.checked, self.control, unchangeable(ready.master))
        sending = Sending(ready.network, known_of(ready.checked), self.feed.traffic, self.mailbox)
        self.page = LivePage(self.document, self.feed, self.control, parameters, sending)
        self.begun.set()
