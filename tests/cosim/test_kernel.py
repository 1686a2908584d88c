"""The decorator of compiled functions."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

FOR = "from numba.core.registry import cpu_target; print(cpu_target.target_context.codegen().magic_tuple())"


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="others are compiled for what they are")
@pytest.mark.parametrize("module", [f"cosim_master.{name}" for name in ("calls", "profiling", "simulation")])
def test_all_is_compiled_for_one_processor_whatever_is_imported_first(module: str) -> None:
    """numba looks once, when it makes its first function; a cache of one processor is of no use for another."""
    imports = f"import {module}, cosim_master.execution, cosim.packets; "
    done = subprocess.run([sys.executable, "-c", imports + FOR], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("'x86-64-v2', '')")
