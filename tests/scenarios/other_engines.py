"""Steps FMUs, each alone, in another engine and prints their real outputs after every step.

``python other_engines.py libcosimpy|ecospy TASKS.json``, a list of [name, FMU, step size, steps, variables]
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path


def libcosim(file: str, step_size: float, steps: int, names: list[str]) -> Iterator[list[float]]:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(step_size * 1e9))  # ns
    slave = execution.add_local_slave(CosimLocalSlave(file, "one"))
    observer = CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    known = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
    for _ in range(steps):
        assert execution.step()
        yield observer.last_real_values(slave, [known[name] for name in names])


def ecos(file: str, step_size: float, steps: int, names: list[str]) -> Iterator[list[float]]:
    # The tbb wheel puts the library that ecospy needs where the loader does not look.
    ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("one", file)
        with EcosSimulation(structure=structure, step_size=step_size) as simulation:
            simulation.init()
            for _ in range(steps):
                simulation.step(1)
                yield [simulation.get_real(f"one::{name}") for name in names]


if __name__ == "__main__":
    run = {"libcosimpy": libcosim, "ecospy": ecos}[sys.argv[1]]
    for name, *task in json.loads(Path(sys.argv[2]).read_text()):
        for row in run(*task):
            print("ROW", name, *map(repr, map(float, row)), flush=True)
    os._exit(0)  # how these tools shut down is not our subject
