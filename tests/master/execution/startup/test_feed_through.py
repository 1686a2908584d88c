"""Outputs that depend directly on inputs: how long values take to pass through, against closed forms.

a is a gain without memory, y = u; b is a lag, y' = 10 ln 2 (-u / 2 - y), which in a step of 0.1 s becomes
b <- b / 2 - u / 4. b starts with 1, a with 0.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.master.fmus.linear import signals

pytestmark = pytest.mark.usefixtures("own_cache")


def looped(linears: Any, tmp_path: Path, master: str) -> dict[str, Any]:
    linears.fmu()
    parts = linears.component("a", gain=1.0, rate=-1.0, step=0.1)
    parts += linears.component("b", x0=1.0, gain=-0.5, rate=10.0 * math.log(2.0), step=0.1)
    result = simulate(linears.ssd(parts, "b/y a/u", "a/y b/u", master=master, stop=0.6), RunOptions(out=tmp_path))
    assert result.outcome == "done", result.error
    return signals(tmp_path)


def test_with_jacobi_an_output_is_that_of_the_input_a_step_before(linears: Any, tmp_path: Path) -> None:
    """b(n + 1) = b(n) / 2 - b(n - 1) / 4, as in the systems in docs/other-engines-files.md that differ by lag."""
    got = looped(linears, tmp_path, "")
    assert got["b.y"] == pytest.approx([1.0, 0.5, 0.0, -0.125, -0.0625, 0.0, 0.015625], abs=1e-14)
    assert list(got["a.y"][1:]) == list(got["b.y"][:-1])


def test_with_gauss_seidel_a_value_passes_without_delay(linears: Any, tmp_path: Path) -> None:
    """b(n + 1) = b(n) / 2 - b(n) / 4: what OMSimulator's exchange gives, too."""
    got = looped(linears, tmp_path, 'algorithm="gauss-seidel"/>')
    assert got["b.y"] == pytest.approx([0.25**n for n in range(7)], abs=1e-14)
