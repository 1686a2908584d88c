"""The loop that is compiled before a run is the one that the run calls."""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cosim.entry import signature_of
from cosim_master.execution import execution
from cosim_master.execution.options import RunOptions
from cosim_master.execution.run import driver
from cosim_master.execution.simulate import simulate
from cosim_master.network.radio.build import grown
from cosim_master.network.radio.confining import roomier
from cosim_master.stepping.warming import EVERY_RUN, IN_PARTS, kernels_of_runs

pytestmark = [
    pytest.mark.usefixtures("own_cache"),
    pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled"),
]


def test_types_of_the_plan_and_the_radio_are_those_of_a_run(
    stricts: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: dict[str, set[str]] = {}

    def watched(module: ModuleType, name: str) -> Any:
        kernel = getattr(module, name)

        def call(*arguments: Any) -> Any:
            called.setdefault(name, set()).add(signature_of(arguments))
            return kernel(*arguments)

        return call

    monkeypatch.setattr(driver, "run", watched(driver, "run"))
    monkeypatch.setattr(execution, "collect_all", watched(execution, "collect_all"))
    stricts.fmu()
    system = stricts.ssd(stricts.component("a") + stricts.component("b"), "a/y b/u")
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    assert called == {name: {signature_of(kernels_of_runs()[name][1])} for name in ("run", "collect_all")}


def test_the_command_writes_what_a_package_brings(tmp_path: Path) -> None:
    """The loop is compiled by then: its code is copied."""
    subprocess.run([sys.executable, "-m", "cosim_master.stepping.warming", str(tmp_path)], check=True)
    files = {file.name.partition("-")[0]: file for file in tmp_path.glob("*/*.kernel")}
    assert set(files) >= {
        *EVERY_RUN,
        *IN_PARTS,
        "work",
        "record",
        "end_here",
        "step_each",
        "step_together",
        "admit",
        "deliver",
    }
    assert files["run"].parent.name == files["places_needed"].parent.name
    done = subprocess.run(
        [sys.executable, "-m", "cosim_master.stepping.warming"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr == "usage: python -m cosim_master.stepping.warming FOLDER\n"


@pytest.mark.parametrize("larger", [grown, roomier])
def test_the_memory_of_a_radio_that_becomes_too_small_is_released(larger: Callable[[Any, int], Any]) -> None:
    """Calls of the loop keep the addresses of its tables; a swarm's radio grows several times."""
    _, (radio, *_) = kernels_of_runs()["deliver"]
    radio = radio._replace(counters=np.zeros(64, np.int64))
    data, posted = weakref.ref(radio.data), weakref.ref(radio.posted)
    signature_of((radio,))
    radio = larger(radio, 5)
    assert (data() if larger is grown else posted()) is None
