"""No order of calls and no argument crashes a compiled FMU, and each call does what the standard's state table says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import fmpy
import pytest

SEQUENCES = 500


@pytest.mark.slow
def test_any_calls_in_any_order(compiled_plant: Path, tmp_path: Path) -> None:
    folder = Path(fmpy.extract(str(compiled_plant), str(tmp_path)))
    (library,) = (folder / "binaries").glob(f"{fmpy.platform}/*")
    guid = fmpy.read_model_description(str(compiled_plant)).guid
    script = Path(__file__).with_name("call_order_fuzz.py")
    command = [sys.executable, "-X", "faulthandler", str(script), str(library), guid, str(SEQUENCES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-6000:]}"
    assert done.stdout.strip() == f"sequences: {SEQUENCES}"
