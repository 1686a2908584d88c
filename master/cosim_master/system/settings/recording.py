"""The recording that a system specifies: the annotation org.uav-cosim.recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cosim_master.diagnostics.errors import (
    Problem,
    SystemDescriptionError,
)
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.annotation import root_annotation

__all__ = ["RECORDING", "Recording", "recording_of"]

RECORDING = "org.uav-cosim.recording"


@dataclass(frozen=True, slots=True)
class Recording:
    """The recording: a row every `interval` s (None: every base step), patterns of signals, and whether with packets.

    <recording xmlns="https://uav-cosim.org/ns/1" interval="0.0125" signals="*.position* *.target" packets="true"/>
    """

    interval: float | None = None
    signals: tuple[str, ...] = ()
    packets: bool = True


def recording_of(checked: CheckedSystem, record: Sequence[str]) -> Recording:
    """Returns the recording that a system specifies; `record` has patterns of signals that replace its own.

    Raises:
        SystemDescriptionError: the annotation is invalid.
    """
    problems: list[Problem] = []
    reader = root_annotation(checked, RECORDING, "recording", problems)
    interval = reader.number("interval", 0.0, 0.0, 1e6)
    written = tuple(reader.text("signals", "").split())
    recording = Recording(
        interval=interval or None,
        signals=tuple(record) or written,
        packets=reader.choice("packets", "true", ("true", "false")) == "true",
    )
    reader.finish()
    reader.children()
    if problems:
        raise SystemDescriptionError(problems)
    return recording
