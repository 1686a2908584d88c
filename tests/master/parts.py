"""Runs in parts whose parts are threads of this process, and assignments of units to parts."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.partitions.transport import local_transports
from cosim_master.execution.simulate import simulate, take_part


def run_in_parts(
    system: Path,
    options: RunOptions,
    parts: int,
    *,
    others: Sequence[RunOptions] = (),
    seconds: float = 600.0,
    **more: Any,
) -> tuple[RunResult, list[BaseException]]:
    """The result of part 0, and the errors that ended other parts.

    Args:
        others: options of the parts after the first, if they differ.
        more: further arguments of `simulate`.
    """
    transports = local_transports(parts, seconds)
    errors: list[BaseException] = []

    def part(number: int) -> None:
        try:
            take_part(system, others[number - 1] if others else options, transports[number], mailbox="mailbox" in more)
        except BaseException as error:
            errors.append(error)
        finally:
            transports[number].close(abort=False)

    threads = [threading.Thread(target=part, args=(n,), daemon=True) for n in range(1, parts)]
    for thread in threads:
        thread.start()
    try:
        result = simulate(system, options, transport=transports[0], **more)
    finally:
        transports[0].close(abort=False)
        for thread in threads:
            thread.join(seconds)
    assert not any(thread.is_alive() for thread in threads)
    return result, errors


def assigned(file: Path, units: Sequence[str], parts: Sequence[int], hosts: Sequence[str] = ()) -> Path:
    """A file that puts each unit into the part of the same place."""
    found: list[dict[str, object]] = [{"units": []} for _ in range(max(parts) + 1)]
    for unit, part in zip(units, parts, strict=True):
        found[part]["units"].append(unit)  # type: ignore[attr-defined]
    for one, host in zip(found, hosts, strict=False):
        one["host"] = host
    file.write_text(json.dumps({"parts": found}), encoding="utf-8")
    return file
