"""Ctrl-C, SIGTERM and SIGHUP.

Imports and options have nothing to tidy up, so the process ends at once. Within a verb, KeyboardInterrupt is raised.
"""

from __future__ import annotations

import os
import signal
from typing import NoReturn

__all__ = ["ends_process", "interrupts_verb"]


_ASKED = [signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__]
"""Signals that ask a process to end."""


def ends_process() -> None:
    """Has them end the process with exit code 130, unless they are ignored or the program has its own handler."""
    for number in _ASKED:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, _end)


def interrupts_verb() -> None:
    """Has these signals raise KeyboardInterrupt, after `ends_process`."""
    for number in _ASKED:
        if signal.getsignal(number) is _end:
            signal.signal(number, signal.default_int_handler)


def _end(*_: object) -> NoReturn:
    os.write(2, b"error: interrupted\n")
    os._exit(130)
