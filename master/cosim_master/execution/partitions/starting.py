"""The agreement of all parts before the run: same version, system, FMUs and cut, and instances that have started."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from cosim_master.diagnostics.errors import CosimError, FmuError, Problem, RunFailed, SystemDescriptionError, Where
from cosim_master.execution.partitions.cut import Cut
from cosim_master.execution.partitions.transport import Transport

__all__ = ["Disagreed", "NotStarted", "Refused", "Who", "agree_to_run", "all_ready", "who"]

_RUN, _RUN_WITH_PACKETS, _END = b"run", b"run, packets", b"end"
_VERSIONS = ("uav-cosim", "numba", "numpy")


class Refused(CosimError):
    """Another part ends the run before it begins; that part, or part 0, says why."""

    def __init__(self) -> None:
        super().__init__("the run ends before it begins, for a reason that part 0 tells")


class Disagreed(SystemDescriptionError):
    """The parts cannot run together; all of them know it."""


class NotStarted(RunFailed):
    """Instances of any part have not started; all parts know it."""


@dataclass(frozen=True, slots=True)
class Who:
    """One part as the manifest tells it: its machine, its processor, and its instances."""

    part: int
    host: str
    processor: str
    instances: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Returns the part for the manifest."""
        return {
            "part": self.part,
            "host": self.host,
            "processor": self.processor,
            "instances": len(self.instances),
            "units": sorted({name.partition(".")[0] for name in self.instances}),
        }


def who(transport: Transport, fingerprint: Mapping[str, str], fmus: Mapping[str, str], cut: Cut) -> dict[str, Any]:
    """Returns what must be equal in all parts, and what tells them apart.

    Args:
        fingerprint: digests of the inputs of the run.
        fmus: digests of the FMUs, by file name.
    """
    return {
        "host": transport.host,
        "processor": _processor(),
        "versions": {"Python": platform.python_version(), **{name: version(name) for name in _VERSIONS}},
        "fmus": dict(fmus),
        "fingerprint": dict(fingerprint),
        "cut": list(cut.of_instance),
    }


def agree_to_run(
    transport: Transport, own: Mapping[str, Any] | CosimError, *, packets: bool = False
) -> tuple[list[dict[str, Any]], bool]:
    """Compares all parts; returns their descriptions, which only part 0 gets, and whether packets are recorded.

    Args:
        own: the description of this part (see `who`), or the reason why it cannot run.
        packets: in part 0, whether it records packets.

    Raises:
        SystemDescriptionError: in part 0, if a part differs or cannot run.
        Refused: in the others.
    """
    told: Mapping[str, Any] = {"error": str(own)} if isinstance(own, CosimError) else own
    others = range(1, transport.parts)
    if transport.part != 0:
        transport.send(0, json.dumps(told).encode())
        answer = transport.receive(0, patient=True)
        if answer not in (_RUN, _RUN_WITH_PACKETS):
            raise Refused
        return [], answer == _RUN_WITH_PACKETS
    found = [dict(told), *(json.loads(transport.receive(part, patient=True)) for part in others)]
    problems = [problem for part in others for problem in _differences(part, found[0], found[part])]
    if isinstance(own, CosimError) or problems:
        for part in others:
            transport.send(part, _END)
        raise own if isinstance(own, CosimError) else Disagreed(problems)
    for part in others:
        transport.send(part, _RUN_WITH_PACKETS if packets else _RUN)
    return found, packets


def _differences(part: int, first: Mapping[str, Any], other: Mapping[str, Any]) -> list[Problem]:
    where = Where(f"part {part} ({other['host']})" if "host" in other else f"part {part}")
    if "error" in other:
        return [] if "error" in first else [Problem(where, str(other["error"]))]
    if "error" in first:
        return []
    wrong = []
    for name, mine in first["versions"].items():
        if (its := other["versions"].get(name)) != mine:
            wrong.append(f"it has {name} {its}, part 0 has {mine}; install the same version everywhere")
    for name, mine in first["fmus"].items():
        if other["fmus"].get(name, mine) != mine:
            wrong.append(f"its {name} is another file than that of part 0; copy or build the same one")
    if not wrong:
        both = {*first["fingerprint"], *other["fingerprint"]}
        different = sorted(n for n in both if first["fingerprint"].get(n) != other["fingerprint"].get(n))
        if different:
            wrong.append(f"its run has other inputs than that of part 0 ({', '.join(different)}); copy the same system")
        elif first["cut"] != other["cut"]:
            wrong.append("it has another cut than part 0; give all parts the same options")
    return [Problem(where, text) for text in wrong]


def all_ready(transport: Transport, failure: Sequence[Any]) -> None:
    """Waits until the instances of all parts have started.

    Args:
        failure: the errors of this part as tuples of FmuError's arguments; empty if it has started.

    Raises:
        RunFailed: in part 0, if instances of any part have not started.
        Refused: in the others.
    """
    others = range(1, transport.parts)
    if transport.part != 0:
        transport.send(0, json.dumps(list(failure)).encode())
        if transport.receive(0, patient=True) != _RUN:
            raise Refused
        return
    failures = [*failure]
    for part in others:
        failures += json.loads(transport.receive(part, patient=True))
    for part in others:
        transport.send(part, _END if failures else _RUN)
    if failures:
        raise NotStarted([FmuError(*one) for one in failures])


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:  # noqa: PTH123
            return next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), "")
    except OSError:
        return platform.processor()
