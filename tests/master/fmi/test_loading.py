"""From FMU files to loaded code: what is unpacked and loaded, and that no FMU runs another one's code."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pyarrow.parquet as pq
import pytest

import cosim.model
from cosim_master.diagnostics.errors import FmuError, SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.slaves.libraries import Libraries, check_sources
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.fmus.probe import model, slave

pytestmark = pytest.mark.usefixtures("own_cache")

MODEL = '''
from cosim import Model, Output, kernel

@kernel
def start(m):
    m.y = {value}
    return 0

@kernel
def advance(m, t, h):
    m.y += 1.0
    return 0

class {name}(Model):
    """Counts from {value}."""
    step_size = 0.5
    variables = (Output("y", unit="1"),)
    kernels = (start, advance)
'''

SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = {value}
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        self.y += {value}
        return True
"""


def rewritten(fmu: Path, member: str, old: str, new: str) -> Path:
    """The FMU with a text replaced in one of its members."""
    with zipfile.ZipFile(fmu) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    assert old.encode() in members[member]
    members[member] = members[member].replace(old.encode(), new.encode())
    with zipfile.ZipFile(fmu, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return fmu


def problem(*fmus: Path) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        check_sources([describe(fmu) for fmu in fmus])
    (only,) = caught.value.problems
    return str(only)


def last(system: Path, out: Path) -> dict[str, float]:
    """Run a system; the last values of its signals."""
    result = simulate(system, RunOptions(out=out))
    assert result.outcome == "done", result.error
    return {name: values[-1] for name, values in pq.read_table(out / "signals.parquet").to_pydict().items()}


def test_a_file_is_loaded_once_and_its_folder_goes_when_the_libraries_close(probes: Any) -> None:
    fmu = describe(probes.fmu())
    with Libraries() as libraries:
        library = libraries.load(fmu)
        assert libraries.load(fmu) is library
        other = libraries.load(describe(probes.fmu("other.fmu")))
        folder, also = library.resources.parent, other.resources.parent
        assert folder != also
        assert (folder / "modelDescription.xml").is_file()
    assert not folder.exists() and not also.exists()


def test_the_same_file_has_two_instances_of_their_own(probes: Any) -> None:
    fmu = describe(probes.fmu())
    with Libraries() as libraries:
        one, two = (libraries.load(fmu).instantiate(name) for name in ("one", "two"))
        p = fmu.variables["p"]
        one.set([p], [1.0])
        two.set([p], [2.0])
        assert (one.get([p]), two.get([p])) == ([1.0], [2.0])
        one.free()
        two.free()


@pytest.mark.parametrize("interpreted", [False, True], ids=["compiled", "interpreted"])
def test_a_wrong_guid(tmp_path: Path, interpreted: bool) -> None:
    kind = "interpreted" if interpreted else "compiled"
    fmu = model(tmp_path, f"guid_{kind}.py", MODEL.format(name="Counter", value=1.0), interpreted=interpreted)
    guid = describe(fmu).guid
    wrong = "00000000-1111-2222-3333-444444444444"
    rewritten(fmu, "modelDescription.xml", guid, wrong)
    with Libraries() as libraries:
        library = libraries.load(describe(fmu))
        if interpreted:  # pythonfmu takes any GUID: it runs what is in the archive
            library.instantiate("one").free()
        else:
            with pytest.raises(
                FmuError, match=f"one: fmi2Instantiate failed: it returned NULL\n.*wrong GUID {wrong}, .*{guid}"
            ):
                library.instantiate("one")


def test_a_stale_interpreted_fmu(tmp_path: Path) -> None:
    """Its bundled cosim is not the one that runs here."""
    fmu = model(tmp_path, "stale.py", MODEL.format(name="Counter", value=1.0), interpreted=True)
    check_sources([describe(fmu)])
    with zipfile.ZipFile(fmu) as archive:
        digest = archive.read("resources/build.json").decode().split('"cosim.model": "')[1][:64]
    rewritten(fmu, "resources/build.json", digest, "0" * 64)
    assert problem(fmu) == (
        f"{fmu}: was built from another cosim.model than the one loaded here ({cosim.model.__file__}); "
        "build the FMUs anew (make fmus), or give one of the modules another name"
    )


def test_two_interpreted_fmus_whose_modules_differ(tmp_path: Path) -> None:
    one = model(tmp_path / "one", "twin.py", MODEL.format(name="Twin", value=1.0), interpreted=True)
    del sys.modules["twin"]
    two = model(tmp_path / "two", "twin.py", MODEL.format(name="Twin", value=2.0), interpreted=True)
    del sys.modules["twin"]
    assert problem(one, two) == (
        f"{two}: was built from another twin than {one}; both would share one; "
        "build the FMUs anew (make fmus), or give one of the modules another name"
    )
    check_sources([describe(one)])
    check_sources([describe(two)])


def test_models_of_one_name_from_different_files_run_their_own_code(tmp_path: Path, probes: Any) -> None:
    """Also beside an FMU of the same sources under another name."""
    one = model(tmp_path / "one", "namesake_a.py", MODEL.format(name="Namesake", value=1.0), interpreted=True)
    two = model(tmp_path / "two", "namesake_b.py", MODEL.format(name="Namesake", value=20.0), interpreted=True)
    entries = set()
    for fmu in (one, two):
        with zipfile.ZipFile(fmu) as archive:
            entries.add(archive.read("resources/slavemodule.txt"))
    assert len(entries) == 2
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(one.read_bytes())
    workshop = probes.workshop
    ports = "y:output"
    parts = "".join(
        workshop.component(n, f.relative_to(tmp_path).as_posix(), ports)
        for n, f in (("a", one), ("b", two), ("c", one), ("d", copy))
    )
    values = last(probes.ssd(parts), tmp_path / "out")
    assert values == {"time": 2.0, "a.y": 5.0, "b.y": 24.0, "c.y": 5.0, "d.y": 5.0}


def test_foreign_python_fmus_are_compared_by_their_files(tmp_path: Path) -> None:
    one = slave(tmp_path / "one", "foreign_twin.py", SLAVE.format(name="One", value=1.0))
    two = slave(tmp_path / "two", "foreign_twin.py", SLAVE.format(name="Two", value=2.0))
    assert f"{two}: was built from another foreign_twin than {one}; both would share one" in problem(one, two)
    check_sources([describe(one), describe(one)])


def test_a_foreign_python_fmu_runs_again_in_the_same_process(tmp_path: Path, probes: Any) -> None:
    fmu = slave(tmp_path, "foreign_again.py", SLAVE.format(name="Again", value=2.0))
    system = probes.ssd(probes.workshop.component("a", fmu.name, "y:output", after=probes.step(0.5)))
    for out in ("first", "second"):
        assert last(system, tmp_path / out)["a.y"] == 10.0
    changed = slave(tmp_path / "new", "foreign_again.py", SLAVE.format(name="Again", value=3.0))
    assert "was built from another foreign_again than the one loaded here" in problem(changed)


def test_a_module_whose_file_is_gone_counts_as_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fmu = slave(tmp_path, "foreign_gone.py", SLAVE.format(name="Gone", value=1.0))
    module = ModuleType("foreign_gone")
    module.__file__ = str(tmp_path / "elsewhere.py")
    monkeypatch.setitem(sys.modules, "foreign_gone", module)
    assert "elsewhere.py" in problem(fmu)


def test_python_fmus_keep_their_place(tmp_path: Path) -> None:
    fmu = describe(model(tmp_path, "kept.py", MODEL.format(name="Kept", value=1.0), interpreted=True))
    places = set()
    for _ in range(2):
        with Libraries() as libraries:
            library = libraries.load(fmu)
            library.instantiate("one").free()
            places.add(library.resources)
            changed = library.resources / "slavemodule.txt"
            assert changed.read_text() != "other"
            changed.write_text("other")  # is unpacked anew
    (place,) = places
    assert not [p for p in place.parent.parent.iterdir() if p.name.startswith("new-")]


def test_a_system_with_a_stale_fmu_is_refused_before_anything_is_loaded(tmp_path: Path, probes: Any) -> None:
    one = model(tmp_path / "one", "stale_twin.py", MODEL.format(name="Twin", value=1.0), interpreted=True)
    del sys.modules["stale_twin"]
    two = model(tmp_path / "two", "stale_twin.py", MODEL.format(name="Twin", value=2.0), interpreted=True)
    del sys.modules["stale_twin"]
    probes.fmu()
    parts = "".join(
        probes.workshop.component(n, f.relative_to(tmp_path).as_posix(), "y:output")
        for n, f in (("a", one), ("b", two))
    )
    system = probes.ssd(probes.component("first") + parts)
    with read_system(system) as structure:
        check(structure)
    with pytest.raises(SystemDescriptionError, match="both would share one"):
        simulate(system, RunOptions(out=tmp_path / "out"))
    assert probes.calls == []
    assert not (tmp_path / "out" / "signals.parquet").exists()
