"""Progress messages of a verb on standard error.

In a terminal: one line that is redrawn, with the time spent; for a run, a bar. Elsewhere (a pipe, a file,
TERM=dumb): a line for each stage that takes longer than a second, none for the others. With -q: nothing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from cosim.deferred import on_compilation
from cosim_master.cli.terminal.console import err, is_live, is_quiet

if TYPE_CHECKING:
    from cosim_master.stepping.observation import Progress

__all__ = ["Activity", "activity", "clock"]

LONG = 1.0
"""Seconds after which a stage gets a line of its own where lines cannot be redrawn."""
OFTEN = 30.0
"""Seconds between two lines about work that is partly done, where lines cannot be redrawn."""


class Activity:
    """The current activity of a verb. This base class shows nothing and is used with -q."""

    def stage(self, text: str, *, long: bool = False) -> None:
        """Begins a stage and ends the previous one.

        Args:
            text: the activity, as "loading 15 FMU instances".
            long: it is known to take longer than a second.
        """

    def starting(self) -> None:
        """Reports that Python modules are being imported, which takes a second. Only terminals show it."""

    def run(self, progress: Progress) -> None:
        """Shows the progress of a run."""

    def share(self, done: float, whole: float, words: str) -> None:
        """Shows a bar of work that is partly done; where lines cannot be redrawn, a line now and then."""

    def end(self) -> None:
        """Ends the stage, because the verb is about to print."""

    @contextmanager
    def interrupted(self) -> Iterator[None]:
        """Suspends the stage while the verb prints within this block."""
        yield


class _Lines(Activity):
    """Prints a line for each stage that takes longer than `LONG`."""

    def __init__(self) -> None:
        self._timer: threading.Timer | None = None
        self._said = ""
        self._told = time.perf_counter()

    def stage(self, text: str, *, long: bool = False) -> None:
        self.end()
        if long:
            if text != self._said:
                err.print(Text(f"{text} ...", "dim"))
            self._said = text
            return
        self._timer = threading.Timer(LONG, lambda: err.print(Text(f"{text} ...", "dim")))
        self._timer.daemon = True
        self._timer.start()

    def run(self, progress: Progress) -> None:  # noqa: ARG002 (a bar is for terminals)
        self.end()

    def share(self, done: float, whole: float, words: str) -> None:  # noqa: ARG002
        self.end()
        if time.perf_counter() - self._told >= OFTEN:
            self._told = time.perf_counter()
            err.print(Text(words, "dim"))

    def end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class _Drawn(Activity):
    """Redraws one line of a terminal ten times a second from its own thread."""

    def __init__(self) -> None:
        self._live = Live(self, console=err, transient=True, redirect_stdout=False, refresh_per_second=10)
        self._spinner = Spinner("dots" if "utf" in err.encoding else "line")
        self._lock = threading.RLock()  # any thread may begin a stage
        self._text: str | None = None
        self._progress: Progress | None = None
        self._share: tuple[float, float, str] | None = None
        self._since = 0.0

    def stage(self, text: str, *, long: bool = False) -> None:  # noqa: ARG002 (it is drawn at once)
        with self._lock:
            if text != self._text:
                self._since = time.perf_counter()
            self._text, self._progress, self._share = text, None, None
            self._live.start()
            self._live.refresh()

    def starting(self) -> None:
        self.stage("starting")

    def run(self, progress: Progress) -> None:
        if self._progress is None:
            self._live.start()
        self._progress = progress

    def share(self, done: float, whole: float, words: str) -> None:
        if self._share is None:
            self._live.start()
        self._share = done, whole, words

    def end(self) -> None:
        with self._lock:
            self._live.stop()
            self._text = self._progress = self._share = None

    @contextmanager
    def interrupted(self) -> Iterator[None]:
        with self._lock:
            self._live.stop()
            yield
            if self._text is not None:
                self._live.start(refresh=True)

    def __rich__(self) -> Any:
        if self._progress is not None:
            return _bar(self._progress)
        if self._share is not None:
            return _drawn_bar(*self._share)
        if self._text is None:
            return Text()
        grid = Table.grid(padding=(0, 1))
        grid.add_column()
        grid.add_column(no_wrap=True, overflow="ellipsis")
        grid.add_column(no_wrap=True)
        grid.add_row(self._spinner, Text(self._text), clock(time.perf_counter() - self._since))
        return grid


def _bar(progress: Progress) -> Table:
    """Returns a bar with the simulated time, the speed, the remaining time, and the number of packets sent."""
    done, whole = progress.time - progress.start, progress.stop - progress.start
    speed = done / progress.wall if progress.wall > 0.0 else 0.0
    left = clock((whole - done) / speed) if speed > 0.0 else "-:--"
    words = f"{done:.1f}/{whole:.1f} s  {speed:.1f} x real time  {left} left  {progress.packets} packets"
    return _drawn_bar(done, whole, words)


def _drawn_bar(done: float, whole: float, words: str) -> Table:
    """Returns a bar with words behind it."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(min_width=4)
    grid.add_column(no_wrap=True, overflow="ellipsis")
    # Ctrl-C writes ^C behind the words: on a line that is full, it would begin another, and the bar would stay.
    grid.add_row(ProgressBar(total=whole, completed=done, width=max(4, min(40, err.width - len(words) - 5))), words)
    return grid


def clock(seconds: float) -> str:
    """Returns a duration [s] as minutes and seconds, with hours if there are any."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


@contextmanager
def activity() -> Iterator[Activity]:
    """Yields the activity of a verb, and removes it from the terminal at the end."""
    doing = Activity() if is_quiet() else _Drawn() if is_live() else _Lines()
    try:
        yield doing
    finally:
        doing.end()


@contextmanager
def compiling(doing: Activity) -> Iterator[None]:
    """Announces compilation by numba within this block.

    The compiler reports the functions that it compiles, not those that it loads from its cache.
    """
    depth = 0

    def tell(function: Callable[..., Any], begins: bool) -> None:
        nonlocal depth
        depth += 1 if begins else -1
        if not begins or depth > 1:
            return
        if function.__module__ == "cosim_master.stepping.kernels.macro_step":
            doing.stage("compiling the stepping loop (once, about 30 s)", long=True)
        else:
            doing.stage(f"compiling {function.__module__}.{function.__qualname__} (once)")

    on_compilation.append(tell)
    try:
        yield
    finally:
        on_compilation.remove(tell)
