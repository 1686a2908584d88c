"""Projects of MasterSim: their slaves, connections, tables and masters; what is refused, and where."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.convert import convert
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.master import MasterSettings, master_settings_of
from tests.master.fmus.strict import ABLE

pytestmark = pytest.mark.usefixtures("own_cache")
TIMES = "# Created: today\n\ntStart 0 a\ntEnd 1500 ms\nhStart 500 ms\nhOutputMin 0.01 s\n"
PAIR = 'simulator 0 0 b #6a5acd "strict.fmu"\nsimulator 1 {cycle} a #ff6a5acd "strict.fmu"\n'
WIRED = "graph a.y b.u\nparameter a.u 1.5\nparameter a.p   2\n"


@pytest.fixture
def place(stricts: Any) -> Path:
    stricts.fmu(flags=ABLE)
    root: Path = stricts.workshop.root
    return root


def written(place: Path, *parts: str) -> Path:
    path = place / "project.msim"
    path.write_text("".join(parts), encoding="utf-8")
    return path


def rows(path: Path, out: Path, *names: str) -> list[list[float]]:
    result = simulate(path, RunOptions(out=out))
    assert result.outcome == "done", result.error
    table = pq.read_table(out / "signals.parquet").to_pydict()
    return [table[name] for name in ("time", *names)]


def settings(path: Path) -> tuple[MasterSettings, tuple[str, ...]]:
    with read_system(path) as structure:
        return master_settings_of(check(structure)), structure.notes


@pytest.mark.parametrize(
    ("mode", "cycle", "expected"),
    [
        ("GAUSS_JACOBI", 0, [0.0, 0.0, 0.75, 2.25]),
        ("GAUSS_SEIDEL", 1, [0.0, 0.0, 0.75, 2.25]),
        ("GAUSS_SEIDEL", 0, [0.0, 0.0, 0.75, 2.25]),
    ],
)
def test_the_order_of_lines_and_cycles_counts_and_not_that_of_dependencies(
    place: Path, tmp_path: Path, mode: str, cycle: int, expected: list[float]
) -> None:
    """b needs the output of a (3 t) and steps before it: its input lags by a step."""
    path = written(place, TIMES, f"MasterMode {mode}\n", PAIR.format(cycle=cycle), WIRED)
    assert rows(path, tmp_path / "out", "a.y", "b.y") == [[0.0, 0.5, 1.0, 1.5], [0.0, 1.5, 3.0, 4.5], expected]


@pytest.mark.parametrize(("cycles", "lines"), [((0, 0), ""), ((1, 0), ""), ((0, 0), "hFallBackLimit 1 s\n")])
def test_gauss_seidel_repeats_the_steps_of_a_cycle(place: Path, cycles: tuple[int, int], lines: str) -> None:
    """So often at most, settled or not; but not a cycle of one slave, and not with steps below hFallBackLimit."""
    pair = PAIR.format(cycle=cycles[1]).replace("0 0 b", f"0 {cycles[0]} b")
    master, _ = settings(written(place, TIMES, f"maxIterations 4\n{lines}", pair, "graph a.y b.u\ngraph b.y a.u\n"))
    repeated = cycles == (0, 0) and not lines
    assert master.iterations == (4 if repeated else 1)
    a, b = 0, 1  # in the order of names
    assert master.loops == (((b, a),) if repeated else ())
    assert master.sequence == ((b, a) if cycles == (0, 0) else (a, b))


def test_a_project_whose_cycle_does_not_settle_goes_on(place: Path, tmp_path: Path) -> None:
    """A step adds p u h to y; b.u is 1 + a.y. b steps first, then a; the second try of b uses the first one of a."""
    wired = "graph a.y b.u 1 1\ngraph b.y a.u\nparameter a.p 4\nparameter b.p 4\n"
    cycle = "maxIterations 2\n" + PAIR.format(cycle=0)
    path = written(place, TIMES, cycle, "simulator 2 1 c #000000 strict.fmu\n", wired, "graph a.y c.u\n")
    assert settings(path)[0].loops == ((1, 0),)
    times, a, b = rows(path, tmp_path / "out", "a.y", "b.y")
    expected = {"a": [a[0]], "b": [b[0]]}
    for _ in times[1:]:
        start = {one: expected[one][-1] for one in "ab"}
        new = dict(start)
        for _ in range(2):
            new["b"] = start["b"] + 4 * (1 + new["a"]) * 0.5
            new["a"] = start["a"] + 4 * new["b"] * 0.5
        for one in "ab":
            expected[one].append(new[one])
    assert (a, b) == (expected["a"], expected["b"])
    assert a[1] == 20.0  # 12 after one try


def test_gauss_seidel_steps_an_earlier_cycle_first(place: Path, tmp_path: Path) -> None:
    """a is the second line, and of an earlier cycle than b: b gets the value of the same time."""
    path = written(place, TIMES, PAIR.format(cycle=0).replace("0 0 b", "0 1 b"), WIRED)
    assert rows(path, tmp_path / "out", "b.y")[1] == [0.0, 0.75, 2.25, 4.5]


def test_offset_and_factor_and_quoted_names(place: Path, tmp_path: Path) -> None:
    """b.u is 1 + 2 a.y, so b.y grows by 0.5, 2, 3.5 (Jacobi)."""
    wired = 'graph "a.y" "b.u" 1 2 0.8 #000000\nparameter a.u 1.5\nparameter a.p 2\n'
    path = written(place, TIMES, "MasterMode GAUSS_JACOBI\n", PAIR.format(cycle=0), wired)
    assert rows(path, tmp_path / "out", "b.y")[1] == [0.0, 0.5, 2.5, 6.0]


@pytest.mark.parametrize(
    "text",
    [
        "Time [min]\tn [-]\tv [C]\n0\t3\t0\n0.01\t4\t9\n0.01\t5\t6\n",
        '"Time [min]","n","v [C]"\n"0","3","0"\n"0.01","5","6"\n',
    ],
)
def test_tables_have_units_of_time_and_both_flavours(place: Path, tmp_path: Path, text: str) -> None:
    """v is 10 t until 0.6 s, then 6; the table steps before a, which gets the values at the end of its step."""
    (place / "in.tsv").write_text(text)
    slaves = 'simulator 0 0 t #000000 "in.tsv"\nsimulator 1 0 a #000000 strict.fmu\n'
    path = written(place, TIMES, slaves, "graph t.v a.u\n")
    times, v, y = rows(path, tmp_path / "out", "t.v", "a.y")
    assert (times, v, y) == ([0.0, 0.5, 1.0, 1.5], [0.0, 5.0, 6.0, 6.0], [0.0, 2.5, 5.5, 8.5])


def test_an_ssp_made_of_a_project_runs_the_same(place: Path, tmp_path: Path) -> None:
    (place / "in.csv").write_text('"time","v"\n"0","1"\n"1","3"\n')
    slaves = "simulator 0 1 t #000000 in.csv\nsimulator 1 0 a #000000 strict.fmu\nsimulator 2 0 b #000000 strict.fmu\n"
    path = written(place, TIMES, slaves, "graph t.v a.u\ngraph a.y b.u 1 2\nparameter a.p 2\n")
    want = rows(path, tmp_path / "out", "t.v", "a.y", "b.y")
    assert want[2] == [0.0, 1.0, 3.0, 6.0]  # a steps before t: 2 * (1, 2, 3) * 0.5
    assert rows(convert(path, tmp_path / "ssp").file, tmp_path / "again", "t.v", "a.y", "b.y") == want


def test_values_have_the_types_of_their_variables(place: Path) -> None:
    values = 'parameter b.s  " two words"\nparameter b.b true\nparameter b.mode 10\nparameter b.p 1e-3\n'
    with read_system(written(place, TIMES, PAIR.format(cycle=0), values)) as structure:
        checked = check(structure)
    start = {one.name: one.start_values for one in checked.instances}["b"]
    assert start == {"s": " two words", "b": True, "mode": 10, "p": 0.001}


def test_times_rows_and_the_step(place: Path, tmp_path: Path) -> None:
    """hStart 0 is a thousandth of the run; a larger hOutputMin is the interval of rows."""
    head = "tEnd 1 min\nhStart 0 s\nhOutputMin 30 s\n"
    times = rows(written(place, head, PAIR.format(cycle=0)), tmp_path / "out", "a.y")[0]
    assert times == [0.0, 30.0, 60.0]
    with read_system(written(place, "tEnd 2 h\n", PAIR.format(cycle=0))) as structure:
        steps = {one.step_size for one in check(structure).instances}
    assert (structure.stop_time, steps) == (7200.0, {600.0})


@pytest.mark.parametrize(
    ("lines", "algorithm", "tolerance", "note"),
    [
        ("maxIterations 3\n", "gauss-seidel", 1e-6, "a cycle is settled when no value changes by more than 1e-06"),
        ("maxIterations 3\nhFallBackLimit 1 s\n", "gauss-seidel", 1e-8, ""),
        ("maxIterations 3\nMasterMode NEWTON\nabsTol 1e-9\n", "quasi-newton", 1e-9, "stops after 3 tries"),
        (
            "adjustStepSize yes\nErrorControlMode STEP_DOUBLING\n",
            "richardson",
            2e-6,
            "Jacobi instead of GAUSS_SEIDEL's",
        ),
        ("adjustStepSize yes\nErrorControlMode ADAPT_STEP\nmaxIterations 4\n", "richardson", 2e-6, "with 4 iterations"),
        (
            "MasterMode GAUSS_JACOBI\nErrorControlMode CHECK\n",
            "jacobi",
            1e-8,
            "ErrorControlMode CHECK, which only reports",
        ),
        ("relTol 0.1\nwriteInternalVariables yes\noutputTimeUnit h\n", "gauss-seidel", 1e-8, "outputTimeUnit"),
        ("preventOversteppingOfEndTime no\n", "gauss-seidel", 1e-8, "a run ends at tEnd"),
    ],
)
def test_the_master(place: Path, lines: str, algorithm: str, tolerance: float, note: str) -> None:
    master, notes = settings(written(place, TIMES, lines, PAIR.format(cycle=0), "graph a.y b.u\ngraph b.y a.u\n"))
    assert (master.algorithm, master.tolerance) == (algorithm, tolerance)
    assert any(note in one for one in notes) if note else not notes


def test_adjusted_steps_end_with_the_run(place: Path, tmp_path: Path) -> None:
    """0.14 s does not divide 0.7 s + 0.02 s; MasterSim ends with a shorter step."""
    times = "tStart 0 s\ntEnd 0.72 s\nhStart 0.14 s\nhMin 1e-5 s\nhMax 0.14 s\nadjustStepSize yes\n"
    project = written(place, times, "ErrorControlMode STEP_DOUBLING\n", PAIR.format(cycle=0), "graph a.y b.u\n")
    master, notes = settings(project)
    assert (master.algorithm, master.maximum_step) == ("richardson", 140_000_000)
    assert master.tolerance == pytest.approx(1e-6 / 0.14)
    text = "hStart, 0.14 s, does not divide the run: the first step and the grid of rows are 0.02 s"
    assert any(text in note for note in notes)
    assert rows(project, tmp_path / "out", "time")[0][-1] == 0.72


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("hStrat 1 s", ':9: there is no keyword "hStrat"; did you mean "hStart"?'),
        ("hMin 1", ':9: hMin is "1"; it must be a number and a unit of: ms, s, min, h, d, a'),
        ("hMin 1 fortnight", ":9: hMin"),
        ("hMin nan s", ":9: hMin"),
        ("MasterMode NEWTON", ":9: NEWTON iterates: maxIterations must be larger than 1"),
        ("MasterMode JACOBI", ':9: MasterMode is "JACOBI"; valid: GAUSS_JACOBI, GAUSS_SEIDEL, NEWTON'),
        ("maxIterations 1.5", ':9: maxIterations is "1.5"'),
        ("ErrorControlMode ADAPT_STEP", "ErrorControlMode adjusts steps: adjustStepSize must be yes"),
        ("adjustStepSize yes", ":9: adjustStepSize needs iterations or ErrorControlMode STEP_DOUBLING"),
        ("tEnd 0 s\nhStart 0 s", ":10: hStart must be positive"),
        ("simulator 2 0 c #000000", ':9: a slave is written "simulator NUMBER CYCLE NAME #COLOR FMU"'),
        ('simulator 2 0 c #000000 "strict.fmu', ":9: a quotation mark is not closed"),
        ("simulator 2 0 a #000000 strict.fmu", ':9: there is a second slave "a"'),
        ("simulator 2 0 a.b #000000 strict.fmu", ':9: the name of a slave must not contain a dot: "a.b"'),
        ("simulator 2 0 c #000000 other.fmu", ':9: there is no file "other.fmu"'),
        ("simulator 2 0 c #000000 strict.so", ':9: "strict.so" is not a slave; valid: an .fmu, a .csv or .tsv file'),
        ("graph a.y", ':9: a connection is written "graph OUTPUT INPUT [OFFSET FACTOR [WIDTH COLOR]]"'),
        ("graph a.y b.u one 2", ":9: offset and factor must be numbers, not one and 2"),
        ("graph c.y b.u", ':9: there is no slave "c"; valid: "a", "b"'),
        ("graph ay b.u", ':9: "ay" is not a variable; it is written SLAVE.VARIABLE'),
        ("graph a.nothing b.u", ':9: strict.fmu has no variable "nothing"; '),
        ("parameter a.mode 1.5", ':9: "a.mode" is Integer and cannot be "1.5"; valid: an integer'),
        ("parameter a.p x", ':9: "a.p" is Real and cannot be "x"; valid: a number'),
        ("parameter a.b yes", ':9: "a.b" is Boolean and cannot be "yes"; valid: true or false'),
        ("parameter a.nothing 1", ':9: a has no variable "nothing"; '),
        ("simulator 2 0 t #000000 in.csv\ngraph t.w b.u", ':10: t has no column "w"; '),
        ("simulator 2 0 t #000000 in.csv\ngraph a.y t.v", ':10: "t.v": t is a table, which has no inputs'),
        ("simulator 2 0 t #000000 in.csv\nparameter t.v 1", ':10: "t.v": t is a table, which has no parameters'),
        (
            "simulator 2 0 t #000000 in.csv\ngraph t.v b.s",
            ':10: "t.v": a column has numbers, and the input is a String',
        ),
        (
            "simulator 2 0 t #000000 in.csv\ngraph t.v b.u\ngraph t.v b.b",
            ':11: "t.v" is connected to a Real and to a Boolean',
        ),
    ],
)
def test_mistakes_are_refused_at_their_line(place: Path, line: str, expected: str) -> None:
    (place / "in.csv").write_text('"Time [s]","v"\n"0","1"\n')
    path = written(place, TIMES, PAIR.format(cycle=0), line + "\n")
    with pytest.raises(SystemDescriptionError) as caught:
        settings(path)
    assert any(expected in str(problem) for problem in caught.value.problems), caught.value.problems


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Time [s]\tv\n", 'in.csv: needs a row of names ("Time [s]", then columns) and one row of values at least'),
        ("Time [fs]\tv\n0\t1\n", 'in.csv:1: its times are in "fs"; valid: ms, s, min, h, d, a'),
        ("Time [s]\tv\tv\n0\t1\t2\n", "in.csv:1: two columns have the same name"),
        ("Time [s]\tv\n0\t1\n1\n", "in.csv:3: has 1 cells; the row of names has 2"),
        ("Time [s]\tv\n0\tx\n", 'in.csv:2: "x" is not a finite number'),
        ("Time [s]\tv\n0\tNaN\n", 'in.csv:2: "NaN" is not a finite number'),
        ("Time [s]\tv\n1\t1\n0\t1\n", "in.csv:3: time 0 s lies before that of the row above, 1 s"),
    ],
)
def test_mistakes_of_tables_are_refused_at_their_line(place: Path, text: str, expected: str) -> None:
    (place / "in.csv").write_text(text)
    path = written(place, TIMES, "simulator 0 0 t #000000 in.csv\nsimulator 1 0 a #000000 strict.fmu\n")
    with pytest.raises(SystemDescriptionError) as caught:
        settings(path)
    assert any(expected in str(problem) for problem in caught.value.problems), caught.value.problems


def test_a_number_of_any_size_is_read_at_once(place: Path, tmp_path: Path) -> None:
    """As an exact fraction, 1e-999999999 has a thousand million digits."""
    (place / "in.csv").write_text("Time [s]\tv\n1e-999999999\t1\n1\t2\n")
    path = written(
        place,
        TIMES.replace("tStart 0 a", "tStart 1e-999999999 a"),
        PAIR.format(cycle=0),
        "simulator 2 0 t #000000 in.csv\ngraph t.v b.u\n",
    )
    (times,) = rows(path, tmp_path / "out")
    assert times[0] == 0.0 and times[-1] == 1.5


@pytest.mark.parametrize(
    ("content", "expected"),
    [(b"\xff", "it is not UTF-8"), (b"# nothing\n", "has no simulators"), (None, "no such file")],
)
def test_files_that_are_none(tmp_path: Path, content: bytes | None, expected: str) -> None:
    path = tmp_path / "x.msim"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SystemDescriptionError, match=expected):
        settings(path)


def test_a_strict_order_names_all_instances_once(stricts: Any) -> None:
    stricts.fmu()
    parts = "".join(stricts.component(name) for name in "ab")
    texts = {
        'order="b"': "strictOrder: order must contain all instances; missing: a",
        'order="a b a"': "strictOrder: order contains an instance twice",
    }
    for order, expected in texts.items():
        master = f'<master xmlns="https://uav-cosim.org/ns/1" algorithm="gauss-seidel" {order} strictOrder="true"/>'
        after = stricts.workshop.annotation("org.uav-cosim.master", master)
        path = stricts.workshop.ssd("s.ssd", stricts.workshop.system(parts, after=after))
        with pytest.raises(SystemDescriptionError, match=expected):
            settings(path)
