"""OspSystemStructure.xml of the Open Simulation Platform: what is read and what is refused; the numbers of libcosim."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system

pytestmark = pytest.mark.usefixtures("own_cache")
_LIBCOSIM = """
import sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
path, steps, *names = sys.argv[1:]
execution = CosimExecution.from_osp_config_file(path)
observer = CosimObserver.create_last_value()
assert execution.add_observer(observer)
ends = []
for name in names:
    simulator, variable = name.split(".")
    slave = execution.slave_index_from_instance_name(simulator)
    (found,) = [v.reference for v in execution.slave_variables(slave) if v.name.decode() == variable]
    ends.append((slave, found))
for _ in range(int(steps)):
    assert execution.step()
    print("ROW", *(repr(float(observer.last_real_values(s, [r])[0])) for s, r in ends), flush=True)
import os
os._exit(0)
"""
HEAD = (
    '<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">\n'
    "<StartTime>0.0</StartTime>\n<BaseStepSize>0.25</BaseStepSize><Algorithm>fixedStep</Algorithm>\n"
)
GROUPS = (
    '<OspModelDescription xmlns="http://opensimulationplatform.com/MSMI/OSPModelDescription" version="1.0">'
    "<VariableGroups>"
    '<Generic name="all"><Generic name="way"><Variable ref="y"/></Generic>'
    '<Generic name="text"><Variable ref="u"/></Generic></Generic>'
    '<Generic name="all back"><Generic name="back way"><Variable ref="u"/></Generic>'
    '<Generic name="back text"><Variable ref="y"/></Generic></Generic>'
    '<Force name="f"><Variable ref="y"/></Force><Force name="g"><Variable ref="u"/></Force>'
    "</VariableGroups></OspModelDescription>"
)


def simulator(name: str, source: str = "strict.fmu", step: str = "", **values: float) -> str:
    inner = "".join(
        f'<InitialValue variable="{key}"><Real value="{value}"/></InitialValue>' for key, value in values.items()
    )
    size = f' stepSize="{step}"' if step else ""
    return f'<Simulator name="{name}" source="{source}"{size}><InitialValues>{inner}</InitialValues></Simulator>\n'


def variable(name: str) -> str:
    simulator_name, _, variable_name = name.partition(".")
    return f'<Variable simulator="{simulator_name}" name="{variable_name}"/>'


def connection(one: str, other: str) -> str:
    return f"<VariableConnection>{variable(one)}{variable(other)}</VariableConnection>\n"


def signal(one: str, function: str, name: str) -> str:
    inner = f'<Signal function="{function}" name="{name}"/>'
    return f"<SignalConnection>{variable(one)}{inner}</SignalConnection>\n"


@pytest.fixture
def place(stricts: Any) -> Path:
    stricts.fmu(step=0.5, complete=True)
    root: Path = stricts.workshop.root
    return root


def written(place: Path, simulators: str, connections: str = "", functions: str = "", head: str = HEAD) -> Path:
    file = place / "OspSystemStructure.xml"
    parts = f"<Functions>{functions}</Functions>\n" if functions else ""
    wires = f"<Connections>\n{connections}</Connections>\n" if connections else ""
    file.write_text(f"{head}<Simulators>\n{simulators}</Simulators>\n{parts}{wires}</OspSystemStructure>\n")
    return file


def both(file: Path, out: Path, names: list[str], steps: int = 12) -> list[list[float]]:
    """The rows of libcosim, after they have been found to be ours."""
    done = subprocess.run(
        [sys.executable, "-c", _LIBCOSIM, str(file.parent), str(steps), *names],
        capture_output=True,
        text=True,
        check=False,
    )
    rows = [[float(x) for x in line.split()[1:]] for line in done.stdout.splitlines() if line.startswith("ROW ")]
    assert len(rows) == steps, done.stderr
    result = simulate(file, RunOptions(out=out, until=0.25 * steps))
    assert result.outcome == "done", result.error
    got = pq.read_table(out / "signals.parquet").to_pydict()
    assert [[got[name][k + 1] for name in names] for k in range(steps)] == rows
    return rows


needs_libcosim = pytest.mark.skipif(sys.platform != "linux", reason="libcosimpy is installed on Linux only")


@needs_libcosim
def test_connections_start_values_and_steps_as_in_libcosim(place: Path, tmp_path: Path) -> None:
    """A loop of two, one of which steps half as often; and a third that steps by 0.6 s, in truth by 0.5 s."""
    parts = simulator("a", p=2.0, u=1.5) + simulator("b", step="0.5", p=0.5) + simulator("c", step="0.6", p=-1.0)
    file = written(place, parts, connection("a.y", "b.u") + connection("b.y", "c.u"))
    rows = both(file, tmp_path / "out", ["a.y", "b.y", "c.y"])
    assert rows[-1][0] == 9.0 and rows[-1][2] < 0.0
    with read_system(file) as structure:
        assert any('"c" steps by 0.5 s, not by 0.6 s' in note for note in structure.notes)


@needs_libcosim
def test_functions_as_in_libcosim(place: Path, tmp_path: Path) -> None:
    """A linear transformation, and a sum of three with different histories; neither takes a step."""
    parts = "".join(simulator(name, p=p, u=1.0) for name, p in (("a", 1.0), ("b", 0.1), ("c", -0.7)))
    parts += simulator("d", p=1.0) + simulator("e", p=0.3)
    functions = '<LinearTransformation name="lt" factor="2.5" offset="-1"/><Sum name="sum" inputCount="3"/>'
    wires = "".join(signal(f"{name}.y", "sum", f"in[{i}]") for i, name in enumerate("abc"))
    wires += signal("d.u", "sum", "out") + signal("a.y", "lt", "in") + signal("e.u", "lt", "out")
    rows = both(written(place, parts, wires, functions), tmp_path / "out", ["a.y", "d.y", "e.y"])
    y = [0.25 * k for k in range(13)]
    expected = sum(0.25 * (1.0 + 0.1 - 0.7) * y[k] for k in range(12))
    assert rows[-1][1] == pytest.approx(expected, rel=1e-12)
    assert rows[-1][2] == pytest.approx(sum(0.25 * 0.3 * (2.5 * y[k] - 1.0) for k in range(12)), rel=1e-12)


def test_ends_come_in_any_order_and_there_may_be_no_connection(place: Path) -> None:
    """The schema has both so, and libcosim's own systems are written so."""
    functions = '<LinearTransformation name="lt" factor="2"/>'
    out = '<SignalConnection><Signal function="lt" name="out"/><Variable simulator="b" name="u"/></SignalConnection>'
    parts = simulator("a") + simulator("b")
    for wires in (signal("a.y", "lt", "in") + out, out + signal("a.y", "lt", "in")):
        (link,) = check(read_system(written(place, parts, wires, functions))).links
        assert (link.source, link.target, link.factor) == (("a", "y"), ("b", "u"), 2.0)
    file = written(place, parts, "\n")
    assert "<Connections>" in file.read_text()
    assert check(read_system(file)).links == ()


@needs_libcosim
def test_groups_as_in_libcosim(place: Path, tmp_path: Path) -> None:
    """Groups of groups, each variable to its counterpart, whichever drives; and a vector sum of groups."""
    model = describe(place / "strict.fmu").model_name
    (place / f"{model}_OspModelDescription.xml").write_text(GROUPS)
    parts = simulator("a", p=2.0, u=1.5) + simulator("b", p=0.5) + simulator("c", p=1.0) + simulator("d", p=0.1)
    functions = '<VectorSum name="sum" inputCount="2" dimension="1"/>'
    group = '<VariableGroup simulator="{}" name="{}"/>'.format
    wires = f"<VariableGroupConnection>{group('a', 'all')}{group('b', 'all back')}</VariableGroupConnection>\n"
    for name, end, port in (("a", "f", "in[0]"), ("b", "f", "in[1]"), ("c", "g", "out")):
        inner = f'<SignalGroup function="sum" name="{port}"/>'
        wires += f"<SignalGroupConnection>{inner}{group(name, end)}</SignalGroupConnection>\n"
    both(written(place, parts, wires, functions), tmp_path / "out", ["a.y", "b.y", "c.y"])


def test_the_sum_is_there_from_the_first_exchange_on(probes: Any, tmp_path: Path) -> None:
    """y = u + p directly: 1 + 2 + 4 while initializing, through one more FMU."""
    probes.fmu()
    parts = "".join(simulator(name, "probe.fmu", p=p) for name, p in (("a", 1), ("b", 2), ("c", 4), ("d", 0), ("e", 0)))
    wires = "".join(signal(f"{name}.y", "sum", f"in[{i}]") for i, name in enumerate("abc"))
    wires += signal("d.u", "sum", "out") + connection("d.y", "e.u")
    file = written(probes.root, parts, wires, '<Sum name="sum" inputCount="3"/>')
    assert simulate(file, RunOptions(out=tmp_path / "out", until=0.5)).outcome == "done"
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert (got["d.y"][0], got["e.y"][0]) == (7.0, 7.0)


def test_times_proxies_and_folders(place: Path) -> None:
    head = HEAD.replace("<StartTime>0.0<", "<StartTime>1.0<").replace(
        "<BaseStepSize>", "<EndTime>4.0</EndTime>\n<BaseStepSize>"
    )
    source = "proxyfmu://localhost?file=strict.fmu"
    written(place, simulator("a", source) + simulator("b"), head=head)
    checked = check(read_system(place))
    assert (checked.start_time, checked.stop_time) == (1.0, 4.0)
    assert [one.step_size for one in checked.instances] == [0.25, 0.25]
    assert any(f"{source}: the FMU is run here, in this process, not by proxyfmu" in note for note in checked.notes)


@pytest.mark.parametrize(
    ("change", "line", "message"),
    [
        (("strict.fmu", "gone.fmu"), 5, 'source "gone.fmu" does not exist: no file'),
        (("strict.fmu", "proxyfmu://localhost:80?guid=1"), 5, "names no file (?file=PATH)"),
        (("strict.fmu", "https://x/strict.fmu"), 5, 'has the scheme "https"'),
        (("<BaseStepSize>0.25", "<BaseStepSize>-1"), 3, "BaseStepSize must be positive"),
        (("<BaseStepSize>0.25", "<BaseStepSize>soon"), 3, '<BaseStepSize> is "soon"; it must be a finite number'),
        (("fixedStep", "ecco"), 3, '<Algorithm> is "ecco"; valid: fixedStep'),
        (("<Simulators>", "<Simulator/><Simulators>"), 4, "<OspSystemStructure> holds no <Simulator>"),
        (('name="b"', 'name="a"'), 6, 'there is a second simulator "a"'),
        (('simulator="b"', 'simulator="bb"'), 9, 'there is no simulator "bb"; did you mean "b"?'),
        (('name="u"', 'name="uu"'), 9, 'strict.fmu has no variable "uu"'),
        (('name="u"', 'name="y"'), 9, "cannot be connected"),
        (("<VariableConnection>", "<VariableConnection powerBond='p'><Variable simulator='a' name='n'/>"), 9, "3 ends"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(place: Path, change: tuple[str, str], line: int, message: str) -> None:
    file = written(place, simulator("a") + simulator("b"), connection("a.y", "b.u"))
    file.write_text(file.read_text().replace(change[0], change[1], 1))
    with pytest.raises(SystemDescriptionError) as caught:
        check(read_system(file))
    (problem,) = [p for p in caught.value.problems if message in p.message]
    assert problem.where.line == line


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('function="lt"', 'function="no"', 'there is no function "no"'),
        ('name="in"', 'name="in[0]"', '"lt" has no signal "in[0]"; valid: in, out'),
        ('name="in[1]"', 'name="in[2]"', '"sum" has no signal "in[2]"; valid: in[0] to in[1], out'),
        ('name="in[1]"', 'name="in[0]"', '"in[0]" of "sum" is connected twice'),
        ('inputCount="2"', 'inputCount="0"', "it must be an integer from 1 to 1000"),
    ],
)
def test_functions_that_are_wrong(place: Path, old: str, new: str, message: str) -> None:
    functions = '<LinearTransformation name="lt" factor="2"/><Sum name="sum" inputCount="2"/>'
    wires = signal("a.y", "lt", "in") + signal("b.u", "lt", "out")
    wires += signal("a.y", "sum", "in[0]") + signal("b.y", "sum", "in[1]") + signal("c.u", "sum", "out")
    file = written(place, "".join(map(simulator, "abc")), wires, functions)
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(SystemDescriptionError) as caught:
        check(read_system(file))
    assert message in str(caught.value)


def test_a_document_of_something_else(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<html/>")
    with pytest.raises(SystemDescriptionError, match="the root element is <html>; it must be <"):
        read_system(tmp_path / "a.xml")
