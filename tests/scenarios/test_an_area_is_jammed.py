"""One element of a network jams radio and GPS: the drone in its area hears nothing, and lands without a position."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cosim_master import RunOptions, simulate
from tests.scenarios.flights import copy_of
from tests.scenarios.test_radio_is_bad import with_radio

GUIDED, LAND = 4, 9
AREA = '<jamming east="10" radius="3" start="12" stop="40" gps="{}"/>'


@pytest.mark.parametrize("gps", ["false", "true"])
def test_the_drone_in_the_area_lands_if_gps_is_jammed_too(gps: str, fmus: Path, tmp_path: Path) -> None:
    system = copy_of("line5", tmp_path / "system", fmus, lambda text: with_radio(text, "", AREA.format(gps)))
    result = simulate(system, RunOptions(out=tmp_path / "run", until=16.0))
    assert result.packets["lost: jammed"] > 0
    names = [f"drone{i}.autopilot.mode" for i in range(1, 6)]
    modes = pq.read_table(tmp_path / "run" / "signals.parquet", columns=names)
    last = [modes[name].to_pylist()[-1] for name in names]
    assert last == [GUIDED, LAND if gps == "true" else GUIDED, GUIDED, GUIDED, GUIDED]
