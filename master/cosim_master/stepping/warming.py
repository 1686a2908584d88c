"""Compiles the stepping loop before a run needs it: while FMUs are built, or into a folder of a wheel.

    python -m cosim_master.stepping.warming FOLDER

writes the machine code of all kernels that Python calls during a run to FOLDER/DIGEST/, where DIGEST is the digest of
their sources. A process looks for the code in ``compiled/DIGEST`` of the package, then in ``kernels/DIGEST`` of the
user's cache folder, and compiles the kernels that are in neither (cosim/kernel.py).
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from cosim.channel import PACKET
from cosim.kernel import PLAIN, used_code
from cosim_master.fmi.calls import CALL
from cosim_master.network.radio import logs, queues, replay, router, topology
from cosim_master.network.radio import tables as radio
from cosim_master.network.radio.tables import Radio
from cosim_master.stepping.kernels import exchange, frames, instances, macro_step, tables, threads
from cosim_master.stepping.kernels.tables import Plan

__all__ = ["EVERY_RUN", "IN_PARTS", "compile_loop", "kernels_of_runs"]

EVERY_RUN = ("run", "collect_all", "places_needed", "sent_bytes", "divide")
"""Kernels that every run requires."""

IN_PARTS = ("outbox_needed", "copies", "replay")
"""Kernels that a run in parts requires besides."""

_STRUCTURED = {
    Plan: {
        "instances": tables.INSTANCE,
        "calls": CALL,
        "feeds": tables.FEED,
        "input_runs": tables.FEED,
        "wires": tables.WIRE,
        "ports": tables.PORTS,
        "groups": tables.GROUP,
        "inboxes": tables.INBOX,
        "delays": tables.DELAY,
        "slopes": tables.SLOPE,
        "ahead": tables.AHEAD,
    },
    Radio: {
        "settings": radio.SETTINGS,
        "endpoints": radio.ENDPOINT,
        "nodes": radio.NODE,
        "channels": radio.CHANNEL,
        "places": radio.PLACE,
        "relayed": radio.RELAYED,
        "trip": radio.RELAYED,
        "trace": radio.TRACED,
        "packet": PACKET,
        "gateways": radio.GATEWAY,
        "dialect": radio.DEFINITION,
        "events": radio.EVENT,
        "outbox": radio.POST,
    },
}
_OF_ROWS = {
    "int_to_real",
    "value_maps",
    "rx",
    "received",
    "encoded",
    "tx",
    "real_block",
    "int_block",
    "positions",
    "order",
    "past",
    "outages",
    "partitions",
    "jamming",
    "obstacles",
    "data",
    "posted",
    "routes",
    "seen",
}


def _empty(kind: type[Any]) -> Any:
    """Returns an empty plan or radio; its arrays have the same types as those of any other."""
    arrays = {}
    for name, hint in get_type_hints(kind).items():
        dtype = _STRUCTURED[kind].get(name) or _element(hint)
        arrays[name] = np.zeros((1, 1) if name in _OF_ROWS else 1, dtype)
    return kind(**arrays)


def _element(hint: Any) -> np.dtype[Any]:
    """Returns the element type of an array type: float64 for NDArray[float64]."""
    last = get_args(hint)[-1]
    kind: np.dtype[Any] = np.dtype((get_args(last) or (last,))[0])
    return kind


def kernels_of_runs() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Returns the kernels that Python calls during a run, by name, with arguments of the types with which it does."""
    plan, air = _empty(Plan), _empty(Radio)
    chosen, port = np.zeros(1, np.int64), np.zeros(1, np.uint8)
    received = np.frombuffer(b"\0", np.uint8)
    reals, bits = np.zeros(1), np.zeros((1, 1), np.uint8)
    return {
        "run": (macro_step.run, (plan, air, frames.NO_FRAMES, 0)),
        "collect_all": (instances.collect_all, (plan,)),
        "places_needed": (macro_step.places_needed, (plan, air)),
        "sent_bytes": (macro_step.sent_bytes, (plan,)),
        "work": (threads.work, (plan, air, 0)),
        "record": (macro_step.record, (plan,)),
        "end_here": (macro_step.end_here, (plan, chosen)),
        "step_each": (instances.step_each, (plan, chosen)),
        "step_together": (instances.step_together, (plan, chosen)),
        "collect_again": (instances.collect_again, (plan, chosen)),
        "admit": (router.admit, (air, reals, 0, 0, received, 0)),
        "deliver": (queues.deliver, (air, 0, 0, port)),
        "divide": (logs.divide, (received, 0, chosen, port)),
        "next_point": (macro_step.next_point, (plan, 0)),
        "feed": (exchange.feed, (plan, 0, plan.feeds)),
        "copies": (topology.copies, (air,)),
        "outbox_needed": (macro_step.outbox_needed, (plan,)),
        "replay": (replay.replay, (air, reals, air.outbox, bits, chosen, bits, 0, 0)),
    }


def compile_loop(names: Sequence[str] | None = None) -> None:
    """Compiles kernels of the loop, or loads their stored code; None: all kernels that Python calls during a run."""
    if PLAIN:
        return
    kernels = kernels_of_runs()
    for name in names or kernels:
        kernel, arguments = kernels[name]
        kernel.prepare(*arguments)


def main(arguments: Sequence[str]) -> None:
    """Writes the code of the loop to the folder that `arguments` name."""
    if len(arguments) != 1:
        sys.exit("usage: python -m cosim_master.stepping.warming FOLDER")
    compile_loop()
    for file in used_code:
        kept = Path(arguments[0]) / file.parent.name / file.name
        kept.parent.mkdir(parents=True, exist_ok=True)
        if kept != file:
            shutil.copyfile(file, kept)


if __name__ == "__main__":
    main(sys.argv[1:])
