"""The master: reads a system of FMUs, checks it, steps it, carries its packets, records it.

    from cosim_master import RunOptions, signals, simulate

    result = simulate("line5", RunOptions(until=60.0, out=Path("out")))
    result.outcome                                     # Outcome.DONE
    signals(result.folder)["drone3.vehicle.position[2]"]

Other programs may rely on the names in `__all__`. Each name is imported at its first use. A program, like each verb of
the command, therefore loads only the parts that it needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim_master.campaigns.campaign import Campaign as Campaign
    from cosim_master.campaigns.campaign import sweep as sweep
    from cosim_master.campaigns.dataset.folder import read_runs as read_runs
    from cosim_master.campaigns.metrics.metric import Metric as Metric
    from cosim_master.campaigns.study.designs import Design as Design
    from cosim_master.campaigns.study.factors import Factor as Factor
    from cosim_master.campaigns.study.study import Study as Study
    from cosim_master.diagnostics.errors import CosimError as CosimError
    from cosim_master.diagnostics.errors import FmuError as FmuError
    from cosim_master.diagnostics.errors import LoopError as LoopError
    from cosim_master.diagnostics.errors import NotConverged as NotConverged
    from cosim_master.diagnostics.errors import RecordingFailed as RecordingFailed
    from cosim_master.diagnostics.errors import RunFailed as RunFailed
    from cosim_master.diagnostics.errors import RunTerminated as RunTerminated
    from cosim_master.diagnostics.errors import StepTooSmall as StepTooSmall
    from cosim_master.diagnostics.errors import SystemDescriptionError as SystemDescriptionError
    from cosim_master.diagnostics.errors import WriteFailed as WriteFailed
    from cosim_master.execution.options import Listener as Listener
    from cosim_master.execution.options import RunOptions as RunOptions
    from cosim_master.execution.outcome.result import Outcome as Outcome
    from cosim_master.execution.outcome.result import RunResult as RunResult
    from cosim_master.execution.preparation.prepare import Prepared as Prepared
    from cosim_master.execution.simulate import simulate as simulate
    from cosim_master.results.reading.comparison import compare as compare
    from cosim_master.results.reading.read import packets as packets
    from cosim_master.results.reading.read import signals as signals
    from cosim_master.stepping.observation import Observer as Observer
    from cosim_master.stepping.observation import Progress as Progress
    from cosim_master.stepping.observation import Seen as Seen
    from cosim_master.stepping.observation import View as View
    from cosim_master.system.authoring.convert import convert as convert
    from cosim_master.system.authoring.pack import pack as pack
    from cosim_master.system.authoring.save import save as save
    from cosim_master.system.authoring.swap import swap as swap
    from cosim_master.system.authoring.swarm.new import new_system as new_system
    from cosim_master.system.authoring.swarm.swarm import Swarm as Swarm
    from cosim_master.system.authoring.terrain import terrain_values as terrain_values
    from cosim_master.system.flatten.check import check as check
    from cosim_master.system.flatten.flat import CheckedSystem as CheckedSystem
    from cosim_master.system.reading.read import read_system as read_system

_WHERE = {
    "Campaign": "campaigns.campaign",
    "CheckedSystem": "system.flatten.flat",
    "CosimError": "diagnostics.errors",
    "Design": "campaigns.study.designs",
    "Factor": "campaigns.study.factors",
    "FmuError": "diagnostics.errors",
    "Listener": "execution.options",
    "LoopError": "diagnostics.errors",
    "Metric": "campaigns.metrics.metric",
    "NotConverged": "diagnostics.errors",
    "Observer": "stepping.observation",
    "Outcome": "execution.outcome.result",
    "Prepared": "execution.preparation.prepare",
    "Progress": "stepping.observation",
    "RecordingFailed": "diagnostics.errors",
    "RunFailed": "diagnostics.errors",
    "RunOptions": "execution.options",
    "RunResult": "execution.outcome.result",
    "RunTerminated": "diagnostics.errors",
    "Seen": "stepping.observation",
    "StepTooSmall": "diagnostics.errors",
    "Study": "campaigns.study.study",
    "Swarm": "system.authoring.swarm.swarm",
    "SystemDescriptionError": "diagnostics.errors",
    "View": "stepping.observation",
    "WriteFailed": "diagnostics.errors",
    "check": "system.flatten.check",
    "compare": "results.reading.comparison",
    "convert": "system.authoring.convert",
    "new_system": "system.authoring.swarm.new",
    "pack": "system.authoring.pack",
    "packets": "results.reading.read",
    "read_runs": "campaigns.dataset.folder",
    "read_system": "system.reading.read",
    "save": "system.authoring.save",
    "signals": "results.reading.read",
    "simulate": "execution.simulate",
    "swap": "system.authoring.swap",
    "sweep": "campaigns.campaign",
    "terrain_values": "system.authoring.terrain",
}

__all__ = [*_WHERE]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, *globals()]
