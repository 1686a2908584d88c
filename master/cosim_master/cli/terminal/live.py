"""Live views of a run: its page (`run --view`), with the browser that opens it, Foxglove and ROS."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Protocol, cast

from cosim_master.cli.terminal.console import announce, note

if TYPE_CHECKING:
    from cosim_master.execution.options import RunOptions
    from cosim_master.execution.outcome.result import RunResult
    from cosim_master.execution.preparation.prepare import Prepared
    from cosim_master.network.gateways.mailbox import Mailbox
    from cosim_master.results.reading.roles import Part
    from cosim_master.stepping.control import Control
    from cosim_master.stepping.observation import Observer, View
    from cosim_master.verdict.findings import Judgement
    from cosim_master.view.live.feed import Feed
    from cosim_master.view.live.server import LivePage
    from cosim_master.view.programs.ros.feed import Transport

__all__ = ["Live", "Onlooker", "Served", "served", "show_in_browser", "shown_live"]


class Onlooker(Protocol):
    """A live view of one run."""

    def observer(self, view: View) -> Observer:
        """Returns the observer of the run."""

    def begin(self, ready: Prepared) -> None:
        """Opens the view of a run that has been checked."""


class Live:
    """The live page of one run.

    Args:
        control: the requests of the page's reader.
        mailbox: the packets that its clicks send.
        open_browser: open a browser if there is a display.
        opened: closes the page in the end.
    """

    def __init__(self, control: Control, mailbox: Mailbox, *, open_browser: bool, opened: ExitStack) -> None:
        self.control, self.mailbox = control, mailbox
        self._open_browser, self._opened = open_browser, opened
        self._feed: Feed | None = None
        self._page: LivePage | None = None
        self._drones: list[Part] = []

    def observer(self, view: View) -> Observer:
        """Returns the observer of the run."""
        from cosim_master.view.live.feed import Feed

        self._feed = Feed(view)
        return self._feed

    def begin(self, ready: Prepared) -> None:
        """Serves the page of a run that has been checked, announces its address, and opens a browser.

        Raises:
            CosimError: no port of loopback can be opened.
        """
        from cosim_master.view.live.document import drones_of, known_of, live_document, live_traffic, shown
        from cosim_master.view.live.parameters import Parameters, unchangeable
        from cosim_master.view.live.sending import Sending
        from cosim_master.view.live.server import LivePage

        assert self._feed is not None
        recorded = self._feed.columns
        columns = shown(recorded, ready.checked)
        self._feed.show(columns)
        self._drones = drones_of(columns, ready.checked)
        hears = ready.recording.packets
        if hears:
            self._feed.traffic = live_traffic(columns, ready.checked, ready.network)
        document = live_document(columns, len(recorded), ready.checked, ready.network, ready.clock, packets=hears)
        parameters = Parameters(ready.checked, self.control, unchangeable(ready.master))
        sending = Sending(ready.network, known_of(ready.checked), self._feed.traffic, self.mailbox)
        self._page = self._opened.enter_context(LivePage(document, self._feed, self.control, parameters, sending))
        announce(f"live view: {self._page.address}")
        if self._open_browser:
            show_in_browser(self._page.address)

    def judged(self, verdict: Judgement) -> None:
        """Tells the page what has been found so far."""
        from cosim_master.view.replay import told_verdict

        if self._feed is not None:
            self._feed.verdict = told_verdict(verdict.as_json(), self._drones)

    def end(self, result: RunResult) -> None:
        """Tells the page how the run has ended."""
        if self._page is None:
            return
        verdict = result.verdict
        if verdict is not None:
            self.judged(verdict)
        good = result.outcome == "done" and (verdict is None or verdict.good)
        kind = "good" if good else "failure" if result.outcome == "failed" else "warning"
        more = "" if result.folder is None else f"uav-cosim view {result.folder}"
        self._page.end((f"ended: {result.outcome}", kind, more))


@contextmanager
def shown_live(options: RunOptions, mailbox: Mailbox, *, open_browser: bool) -> Iterator[Live]:
    """Yields the live page of a run, which is made when the run has been checked; closes it in the end.

    `mailbox` takes the packets that its clicks send.
    """
    import websockets.asyncio.server  # noqa: F401 (if it is missing, the run does not begin)

    from cosim_master.stepping.control import Control

    with ExitStack() as opened:
        control = Control(1.0 if options.pace is None else options.pace)
        yield Live(control, mailbox, open_browser=open_browser, opened=opened)


class Served:
    """The server or publisher of one run for other programs.

    Args:
        make: returns the observer of the run, which has a method `close`.
        serve: opens its port or topics, for a run that has been checked.
        told: returns the line that announces it.
    """

    def __init__(
        self, make: Callable[[View], Any], serve: Callable[[Any, Prepared], None], told: Callable[[Any], str]
    ) -> None:
        self._make, self._serve, self._told = make, serve, told
        self._feed: Any = None

    def observer(self, view: View) -> Observer:
        """Returns the observer of the run."""
        self._feed = self._make(view)
        return cast("Observer", self._feed)

    def begin(self, ready: Prepared) -> None:
        """Opens the server of a run that has been checked, and announces it.

        Raises:
            CosimError: it cannot be opened.
        """
        self._serve(self._feed, ready)
        announce(self._told(self._feed))

    def close(self) -> None:
        """Closes it."""
        if self._feed is not None:
            self._feed.close()


@contextmanager
def served(foxglove: int | None, ros1: str | None, ros2: int | None, mailbox: Mailbox) -> Iterator[list[Served]]:
    """Yields the servers of a run, which are opened when the run has been checked; closes them in the end.

    Args:
        foxglove: port of the server for Foxglove; None: there is none.
        ros1: address of the master of ROS 1; None: nothing is published there.
        ros2: domain of ROS 2; None: nothing is published there.
        mailbox: takes the packets made from set-points from ROS.
    """
    found = []
    if foxglove is not None:
        from cosim_master.view.programs.foxglove_server import FoxgloveFeed

        found.append(
            Served(
                FoxgloveFeed,
                lambda feed, ready: feed.serve(ready.checked, foxglove),
                lambda feed: f"Foxglove: ws://127.0.0.1:{feed.port}",
            )
        )
    if ros2 is not None:
        from cosim_master.view.programs.ros.ros2 import Ros2

        found.append(_ros(Ros2(ros2), f"ROS 2: domain {ros2}", mailbox))
    if ros1 is not None:
        from cosim_master.view.programs.ros.ros1 import Ros1

        found.append(_ros(Ros1(ros1), f"ROS 1: {ros1}", mailbox))
    try:
        yield found
    finally:
        for one in found:
            one.close()


def _ros(transport: Transport, where: str, mailbox: Mailbox) -> Served:
    from cosim_master.view.programs.ros.feed import RosFeed

    def told(feed: Any) -> str:
        published, heard = feed.topics
        return f"{where}, publishes {len(published)} topics, hears {len(heard)}"

    return Served(
        lambda view: RosFeed(view, transport, note),
        lambda feed, ready: feed.serve(ready.checked, ready.network, mailbox, packets=ready.recording.packets),
        told,
    )


def show_in_browser(address: str) -> None:
    """Opens an address in a browser that can have a window; one in the terminal would take it from the command."""
    has_display = sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not (has_display and webbrowser.open(address)):
        note("no browser was found here; open this address in one")
