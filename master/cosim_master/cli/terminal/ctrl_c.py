"""Ctrl-C outside of verbs: imports and options have nothing to tidy up, so it ends the process at once."""

from __future__ import annotations

import os
import signal
from typing import NoReturn

__all__ = ["ends_process", "interrupts_verb"]


def ends_process() -> None:
    """Has Ctrl-C end the process with exit code 130, unless it is ignored, or the program has its own handler."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def interrupts_verb() -> None:
    """Has Ctrl-C raise KeyboardInterrupt again, after `ends_process`."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(*_: object) -> NoReturn:
    os.write(2, b"error: interrupted\n")
    os._exit(130)
