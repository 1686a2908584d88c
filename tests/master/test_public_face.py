"""What `import cosim_master` exports."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import cosim_master
from cosim import packets
from cosim.kernel import PLAIN
from cosim_master.diagnostics import errors
from cosim_master.system.settings.radio import nodes


def test_these_names_and_no_others() -> None:
    assert sorted(cosim_master.__all__) == [
        "Campaign",
        "CheckedSystem",
        "CosimError",
        "Design",
        "Factor",
        "FmuError",
        "Listener",
        "LoopError",
        "Metric",
        "NotConverged",
        "Observer",
        "Outcome",
        "Prepared",
        "Progress",
        "RecordingFailed",
        "RunFailed",
        "RunOptions",
        "RunResult",
        "RunTerminated",
        "Seen",
        "StepTooSmall",
        "Study",
        "Swarm",
        "SystemDescriptionError",
        "View",
        "WriteFailed",
        "check",
        "compare",
        "convert",
        "new_system",
        "pack",
        "packets",
        "read_runs",
        "read_system",
        "save",
        "signals",
        "simulate",
        "swap",
        "sweep",
        "terrain_values",
    ]


@pytest.mark.parametrize("name", cosim_master.__all__)
def test_each_has_a_docstring_and_says_where_it_is(name: str) -> None:
    found: Any = getattr(cosim_master, name)
    assert found.__doc__
    assert found.__name__ == name
    assert name in dir(cosim_master)


def test_every_error_is_among_them() -> None:
    raised = {name for name, one in vars(errors).items() if isinstance(one, type) and issubclass(one, Exception)}
    assert raised <= {*cosim_master.__all__}


def test_another_name_is_an_error() -> None:
    with pytest.raises(AttributeError, match="module 'cosim_master' has no attribute 'nothing'"):
        _ = cosim_master.nothing


def test_nothing_heavy_is_imported_before_it_is_used(fmus: Path) -> None:
    """Not even numba, which takes half a second, where a system with a radio is checked."""
    code = """
import sys, cosim_master
print(*({"numba", "numpy", "pyarrow", "lxml"} & {*sys.modules}))
from cosim_master.cli.verbs.systems import check
check("line5")
print("numba" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    first, *_, last = done.stdout.splitlines()
    assert (first, last) == ("", "False")


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_a_run_whose_code_is_kept_does_not_import_numba(fmus: Path, tmp_path: Path) -> None:
    code = f"""
import sys
from pathlib import Path
from cosim_master import RunOptions, simulate
settings = {{"plain": {{}}, "threads": {{"threads": 2}}, "profile": {{"profile": True}}}}
for name in sys.argv[1:]:
    result = simulate("line5", RunOptions(until=0.5, out=Path({str(tmp_path)!r}) / name, **settings[name]))
    print(result.outcome.value, "numba" in sys.modules)
"""
    for names in (["plain", "threads"], ["plain", "threads", "profile"]):  # the first may compile
        done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["done False", "done False", "done True"]  # what measures is compiled each time


def test_the_smallest_port_holds_the_largest_packet() -> None:
    assert nodes.MAX_PACKET == packets.MAX_PACKET


def test_a_run_from_python(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    system = probes.ssd(probes.workshop.component("a", "probe.fmu"), stop=0.5)
    result = cosim_master.simulate(system, cosim_master.RunOptions(until=0.5, out=tmp_path / "out"))
    assert result.outcome is cosim_master.Outcome.DONE
    assert result.outcome == "done"
    table = cosim_master.signals(tmp_path / "out")
    assert table.column_names[0] == "time"
    assert table["time"][-1].as_py() == 0.5
    assert cosim_master.signals(tmp_path / "out", ["time"]).column_names == ["time"]
    with pytest.raises(cosim_master.CosimError, match=r"nothing was recorded of b\.x"):
        cosim_master.signals(tmp_path / "out", ["b.x"])
    with pytest.raises(cosim_master.CosimError, match="no packets were recorded"):
        cosim_master.packets(tmp_path / "out")


def test_packets_of_a_run(fmus: Path, tmp_path: Path) -> None:
    cosim_master.simulate("line5", cosim_master.RunOptions(until=0.5, out=tmp_path / "out"))
    found = cosim_master.packets(tmp_path / "out")
    assert isinstance(found, pa.Table)
    assert {"sent", "source", "target", "outcome"} <= {*found.column_names}
    file = tmp_path / "out" / "packets.parquet"
    assert len(found) > 5
    half = pa.array([b"drone\xe7"] * len(found)).view(pa.string())  # what one wrong bit makes of a name
    pq.write_table(found.set_column(found.column_names.index("source"), "source", half), file)
    with pytest.raises(cosim_master.SystemDescriptionError, match=r"packets.parquet: damaged since .* UTF8"):
        cosim_master.packets(tmp_path / "out")
    pq.write_table(found.rename_columns(["sent", *found.column_names[1:-1], "outcxme"]), file)
    with pytest.raises(cosim_master.SystemDescriptionError, match=r"packets.parquet: no column outcome; packets of a"):
        cosim_master.packets(tmp_path / "out")
    file.write_bytes(b"PAR1 cut short")
    with pytest.raises(cosim_master.SystemDescriptionError, match="not a complete Parquet file"):
        cosim_master.packets(tmp_path / "out")
