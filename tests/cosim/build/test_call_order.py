"""No order of calls and no argument crashes a compiled FMU, and each call does what the standard's state table says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import fmpy
import pytest

SEQUENCES = 200
ROOT = Path(__file__).parents[3]


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_any_calls_in_any_order(compiled_plant: Path, plant3: Path, tmp_path: Path, fmi: int) -> None:
    plant = {2: compiled_plant, 3: plant3}[fmi]
    folder = Path(fmpy.extract(str(plant), str(tmp_path)))
    (library,) = (folder / "binaries").glob(f"{fmpy.platform if fmi == 2 else fmpy.platform_tuple}/*")
    guid = fmpy.read_model_description(str(plant)).guid
    script = f"tests.cosim.build.call_order_fmi{fmi}"
    command = [sys.executable, "-X", "faulthandler", "-m", script, str(library), guid, str(SEQUENCES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-6000:]}"
    assert done.stdout.strip() == f"sequences: {SEQUENCES}"
