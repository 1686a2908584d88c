"""Models that are wrong: each gives an error with file, line, and how to write it; none changes memory that is not its
own."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent, indent
from typing import Any

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave, fmi3LogMessageCallback

from cosim.build import CannotCompile, build, build_all, load_models, models_of_package
from cosim.build.description import degrees_of
from cosim.build.faults import doubts_of, refusals_of, shared_of

MODEL = """\
import math
import random
import time
from datetime import datetime
from enum import IntEnum
from random import gauss

import numpy as np

from cosim import Input, Memory, Model, Output, PacketOutput, Parameter, kernel
from cosim.fields import get_whole, set_real

SIZES = {{"small": 1}}
SEEN = np.zeros(3)
VISITED = []
NOISE = np.random.default_rng(1)


def plain(x):
    return x


@kernel
def half(x):
    return 0.5 * x


@kernel
def fill(values, n):
    for i in range(n):
        values[i] = 7.0


@kernel
def double(m, factor):
    m.y = factor * m.u
{helper}

@kernel
def start(m):
    return 0


@kernel
def advance(m, t, h):
{body}


class Gauge(Model):
    \"\"\"A gauge.\"\"\"

    step_size = 0.1
    variables = (
        Output("y"),
        Output("v", shape=3),
        Output("energy", start=100.0),
        Input("u", start=0.5),
        Input("w", shape=3, start=0.5),
        Parameter("n", type=int, start=3),
        Parameter("case", type=int),
        Memory("table", shape=(2, 4)),
        Memory("counts", dtype="i4", shape=3),
        Memory("x", shape=5),
        PacketOutput("tx", capacity=10),
    )
    kernels = (start, advance)
    errors = {{7: "the gauge is broken"}}
"""


@pytest.fixture
def loaded() -> Iterator[Any]:
    """Loads a model of this text; its module is forgotten afterwards."""
    names: list[str] = []

    def load(folder: Path, body: str, helper: str = "") -> Any:
        file = folder / "gauge.py"
        text = indent(dedent(body).strip(), "    ")
        file.write_text(MODEL.format(body=text, helper=f"\n\n{dedent(helper).strip()}\n" if helper else ""))
        sys.modules.pop("gauge", None)
        names.append("gauge")
        (model,) = load_models(str(file))
        return model

    yield load
    for name in names:
        sys.modules.pop(name, None)


def line_of(file: Path, text: str) -> int:
    """The line of the kernel `advance` that begins with `text`."""
    lines = file.read_text().splitlines()
    begin = lines.index("def advance(m, t, h):")
    return next(i for i, line in enumerate(lines[begin:], start=begin + 1) if line.strip().startswith(text))


REMEMBERS = "what a kernel remembers are variables of its record (State, Memory)"
NO_RANDOM = "a kernel has no random numbers of its own; use normal_pair or threefry of cosim.random_numbers"
NO_CLOCK = "a kernel has no clock; the time of the run [s] is the argument t"
AT_BUILD = {
    "a variable that is not declared": (
        "m.z = t",
        "m.z",
        'no variable "z" in Gauge; there are case, counts, energy, n, table, tx, tx_len, u, v, w, x, y',
    ),
    "a library that is not imported": (
        "m.y = numpy.pi",
        "m.y",
        'no name "numpy"; write import numpy at the top of the module',
    ),
    "a misspelt variable": ("m.energi = t", "m.energi", 'no variable "energi" in Gauge; did you mean "energy"?'),
    "a misspelt variable that is read": (
        "m.y = m.tx_lenn",
        "m.y",
        'no variable "tx_lenn" in Gauge; did you mean "tx_len"?',
    ),
    "an array that is assigned whole": (
        "m.v = m.counts",
        "m.v",
        "m.v = m.counts copies an array: write m.v[:] = m.counts",
    ),
    "an array of another length": ("m.v = m.x", "m.v", "m.v is an array of 3, m.x one of 5"),
    "a slice that is assigned to an array": (
        "m.v = m.x[:3]",
        "m.v",
        "m.v = m.x[:3] assigns to an array of 3: write m.v[:] = m.x[:3]",
    ),
    "a number that is assigned to an array": (
        "m.v = 0.0",
        "m.v",
        "m.v = 0.0 assigns to an array of 3: write m.v[:] = 0.0",
    ),
    "a sum of arrays": (
        "m.v[:] = m.w[:] + 1.0",
        "m.v",
        "m.w[:] + 1.0 creates an array, which a kernel cannot: write a loop",
    ),
    "an array that is assigned to a scalar": (
        "m.y = m.w",
        "m.y",
        "m.y is a scalar, m.w is an array of 3: give it an element of it",
    ),
    "a tuple that is assigned to a scalar": (
        "m.y = (1.0, 2.0)",
        "m.y",
        "m.y is a scalar: it cannot be given a tuple; declare it with shape=2",
    ),
    "an index of a scalar": ("m.y = m.u[0]", "m.y", "m.u is a scalar and has no elements; declare it with shape="),
    "too many indices": ("m.y = m.v[0, 1]", "m.y", "m.v has 1 dimension, not 2"),
    "an index that is no int": ("m.y = m.v[1.0]", "m.y", "index 1.0 of m.v: an index is an int"),
    "an undefined name": ("m.y = gian * t", "m.y", 'no name "gian"'),
    "a misspelt kernel": ("m.y = halff(t)", "m.y", 'no name "halff"; did you mean "half"?'),
    "a misspelt function of a module": ("m.y = math.sqr(t)", "m.y", 'math has no "sqr"; did you mean "sqrt"?'),
    "a function that is not a kernel": ("m.y = plain(t)", "m.y", "plain is not a kernel: write @kernel above its def"),
    "too few arguments": ("double(m)", "double(m)", "double(m, factor): missing a required argument: 'factor'"),
    "too many arguments": ("m.y = half(t, h)", "m.y", "half(x): too many positional arguments"),
    "a dict": (
        'm.y = {"a": 1.0}["a"]',
        "m.y",
        f"a kernel has no dicts; {REMEMBERS}",
    ),
    "a list": (
        "values = [1.0, t]\nvalues.append(2.0)\nm.y = values[0]",
        "values = ",
        f"a kernel has no lists; write a tuple, (1.0, 2.0); {REMEMBERS}",
    ),
    "a set": ("m.y = len({m.u, t})", "m.y", "a kernel has no sets; write the comparisons out"),
    "a string": (
        'name = "a" + str(t)\nm.y = len(name)',
        "name",
        "a kernel has no strings; use an IntEnum, or return a key of errors",
    ),
    "a new array": (
        "m.y = np.zeros(3).sum()",
        "m.y",
        "np.zeros creates an array, which a kernel cannot: declare a Memory",
    ),
    "an exception that is caught": (
        "try:\n    m.y = t\nexcept ValueError:\n    pass",
        "try:",
        "a kernel does not catch exceptions; test for the condition first",
    ),
    "a file": ('print(open("x").read())', "print", "a kernel has no print()"),
    "a function within": (
        "def f(x):\n    return np.zeros(3)\nm.y = f(t).sum()",
        "def f",
        "a kernel has no nested functions; write a @kernel at module level",
    ),
    "an import": ("import os\nm.y = len(os.sep)", "import os", "a kernel does not import; import at module level"),
    "a global variable": (
        "global total\ntotal = t",
        "global",
        f"a kernel has no global variables; {REMEMBERS}",
    ),
    "a random number": ("m.y = random.random()", "m.y", f"random.random: {NO_RANDOM}"),
    "a random number of numpy": ("m.y = np.random.normal(0.0, 1.0)", "m.y", f"np.random.normal: {NO_RANDOM}"),
    "an imported random number": ("m.y = gauss(0.0, 1.0)", "m.y", f"gauss: {NO_RANDOM}"),
    "a generator of the module": ("m.y = NOISE.normal()", "m.y", f"NOISE.normal: {NO_RANDOM}"),
    "the clock": ("m.y = time.time()", "m.y", f"time.time: {NO_CLOCK}"),
    "the date": ("m.y = datetime.now().second", "m.y", f"datetime.now: {NO_CLOCK}"),
    "an array of the module": (
        "SEEN[0] += 1.0",
        "SEEN[0]",
        f"SEEN is an array of the module, which is constant in a kernel; {REMEMBERS}",
    ),
    "a dict of the module": (
        "m.y = SIZES[1]",
        "m.y",
        f"SIZES is a dict of the module; a kernel has no dicts; {REMEMBERS}",
    ),
    "a list of the module": (
        "VISITED.append(t)",
        "VISITED",
        f"VISITED is a list of the module; a kernel has no lists; {REMEMBERS}",
    ),
    "types that do not agree": (
        "x = 1.0\nif t > 1.0:\n    x = (1.0, 2.0)\nm.y = x",
        "m.y = x",
        "x is a float in one place and a tuple in another; give it one type",
    ),
}


@pytest.mark.parametrize("case", AT_BUILD)
def test_what_is_wrong_with_a_kernel_is_told_when_it_is_built(case: str, loaded: Any, tmp_path: Path) -> None:
    body, at, message = AT_BUILD[case]
    model = loaded(tmp_path, f"{body}\nreturn 0")
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    file = tmp_path / "gauge.py"
    first = str(failed.value).splitlines()[0]
    assert first.startswith(f"Gauge: {file}:{line_of(file, at)}: {message}"), failed.value
    assert not (tmp_path / "fmus" / "Gauge.fmu").exists()


RECURSION = """
@kernel
def factorial(n):
    if n < 2:
        return 1
    return n * factorial(n - 1)
"""


def test_recursion_is_refused(loaded: Any, tmp_path: Path) -> None:
    model = loaded(tmp_path, "m.y = factorial(m.n)\nreturn 0", RECURSION)
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    line = next(i for i, text in enumerate((tmp_path / "gauge.py").read_text().splitlines(), 1) if "n - 1" in text)
    assert str(failed.value) == f"Gauge: {tmp_path / 'gauge.py'}:{line}: factorial calls itself; write a loop"


CALLED = """
@kernel
def law(m, t):
{body}


def around(law):
    @kernel
    def decide(m, t):
        which{annotation} = law(m, t)
        return which

    return decide


decide = around(law)
"""
TO_RETURN = "it is to return an int"


@pytest.mark.parametrize(
    ("body", "at", "message"),
    [
        ("m.y = t", "m.y = t", f"law returns nothing; {TO_RETURN}: end it with return and its value"),
        ("while True:\n    m.y = t", "while", f"law returns nothing; {TO_RETURN}: end it with return and its value"),
        ("m.y = t\nreturn", "return", f"law returns nothing; {TO_RETURN}: end it with return and its value"),
        ("if t > 1.0:\n    return 2\nreturn 1.5", "return 1.5", f"law returns a float; {TO_RETURN}"),
        ("x = t\nreturn x", "return x", f"law returns a float; {TO_RETURN}"),
        ("return 1, 2", "return 1, 2", f"law returns a tuple; {TO_RETURN}"),
    ],
)
def test_a_kernel_that_returns_another_type_is_blamed_instead_of_its_caller(
    body: str, at: str, message: str, loaded: Any, tmp_path: Path
) -> None:
    """The caller, which may be in a library, says what it needs."""
    for annotation, head in ((": int", "def law(m, t):"), ("", "def law(m, t) -> int:")):
        helper = CALLED.format(body=indent(body, "    "), annotation=annotation).replace("def law(m, t):", head)
        model = loaded(tmp_path, "if decide(m, t) & 2 != 0:\n    return 7\nreturn 0", helper)
        with pytest.raises(CannotCompile) as failed:
            build(model, tmp_path / "fmus")
        lines = (tmp_path / "gauge.py").read_text().splitlines()
        first = lines.index(head)
        line = next(i for i, text in enumerate(lines[first:], first + 1) if text.strip().startswith(at))
        assert str(failed.value) == f"Gauge: {tmp_path / 'gauge.py'}:{line}: {message}"


@pytest.mark.parametrize(
    ("body", "at", "message"),
    [
        ("return True", "return True", f"law returns a bool, True; {TO_RETURN}"),
        ("if t > 1.0:\n    return False\nreturn 2", "return False", f"law returns a bool, False; {TO_RETURN}"),
        ("return t > 1.0 and not m.n > 2", "return", f"law returns a bool, t > 1.0 and (not m.n > 2); {TO_RETURN}"),
        ("done = False\nif t > 1.0:\n    done = True\nreturn done", "return", f"law returns a bool, done; {TO_RETURN}"),
    ],
)
@pytest.mark.parametrize("head", ["def law(m, t):", "def law(m, t) -> int:"])
def test_a_bool_where_the_caller_needs_an_int_is_refused(
    body: str, at: str, message: str, head: str, loaded: Any, tmp_path: Path
) -> None:
    helper = CALLED.format(body=indent(body, "    "), annotation=": int").replace("def law(m, t):", head)
    model = loaded(tmp_path, "if decide(m, t) & 2 != 0:\n    return 7\nreturn 0", helper)
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    lines = (tmp_path / "gauge.py").read_text().splitlines()
    first = lines.index(head)
    line = next(i for i, text in enumerate(lines[first:], first + 1) if text.strip().startswith(at))
    assert str(failed.value) == f"Gauge: {tmp_path / 'gauge.py'}:{line}: {message}"


def test_a_kernel_of_its_own_may_return_a_bool_as_an_int(loaded: Any, tmp_path: Path) -> None:
    helper = "@kernel\ndef above(m) -> int:\n    return m.u > 1.0\n"
    assert build(loaded(tmp_path, "m.n += above(m)\nreturn 0", helper), tmp_path).compiled


@pytest.mark.parametrize(
    "body", ["return True and 2", "done = 1\nif t > 1.0:\n    done = 2\nreturn done", "return int(t > 1.0)"]
)
def test_a_kernel_that_may_return_an_int_is_not_blamed(body: str, loaded: Any, tmp_path: Path) -> None:
    helper = CALLED.format(body=indent(body, "    "), annotation=": int")
    assert build(loaded(tmp_path, "if decide(m, t) & 2 != 0:\n    return 7\nreturn 0", helper), tmp_path).compiled


def test_a_bool_in_place_of_an_int_is_refused_in_an_interpreted_fmu(loaded: Any, tmp_path: Path) -> None:
    helper = CALLED.format(body="    return True", annotation=": int")
    model = loaded(tmp_path, "if decide(m, t) & 2 != 0:\n    return 7\nreturn m.u > 1.0", helper)
    with pytest.raises(ValueError) as failed:
        build(model, tmp_path, interpreted=True)
    told = [line.split(": ", 2)[2] for line in str(failed.value).splitlines()]
    assert told == [
        f"law returns a bool, True; {TO_RETURN}",
        "advance returns 0, or a key of errors, not m.u > 1.0",
    ]


def test_a_call_that_only_a_python_process_can_make_is_told_where_it_is(loaded: Any, tmp_path: Path) -> None:
    model = loaded(tmp_path, "double(m, t)\nshow(m)\nreturn 0", "@kernel\ndef show(m):\n    print(1.0)\n")
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    line = next(i for i, text in enumerate((tmp_path / "gauge.py").read_text().splitlines(), 1) if "print(" in text)
    assert str(failed.value) == f"Gauge: {tmp_path / 'gauge.py'}:{line}: a kernel has no print()"


@pytest.mark.parametrize(
    ("body", "at", "message"),
    [
        ("m.y = t", "m.y = t", "advance returns 0, or a key of errors: end it with return 0"),
        ("m.y = t\nreturn", "return", "advance returns 0, or a key of errors: write return 0"),
        ("m.y = t\nreturn 0.0", "return 0.0", "advance returns 0, or a key of errors, not 0.0"),
        ("m.y = t\nreturn m.y", "def advance", "it returns a float; a kernel returns 0 or a key of errors"),
    ],
)
def test_wrong_returns(body: str, at: str, message: str, loaded: Any, tmp_path: Path) -> None:
    model = loaded(tmp_path, body)
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    lines = (tmp_path / "gauge.py").read_text().splitlines()
    first = lines.index("def advance(m, t, h):")
    line = next(i for i, text in enumerate(lines[first:], first + 1) if text.strip().startswith(at))
    told = [f"Gauge: {tmp_path / 'gauge.py'}:{line - d}: {message}" for d in (0, 1)]  # of a function, its decorator
    assert str(failed.value) in told


def test_all_faults_are_told_at_once(loaded: Any, tmp_path: Path) -> None:
    model = loaded(tmp_path, "m.z = t\nm.y = lost\nsquare(m)\nreturn 0", "@kernel\ndef square(m):\n    m.yy = 1.0\n")
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    told = [line.split(": ", 2)[2] for line in str(failed.value).splitlines()]
    assert [text.split(";")[0] for text in told] == [
        'no variable "yy" in Gauge',
        'no variable "z" in Gauge',
        'no name "lost"',
    ]


SPREAD = """
@kernel
def area(length, width, height):
    return length * width + height


@kernel
def spread(m, t):
    sides = (t, 2.0)
    return area(*sides, m.u) + area(m.u, *sides) + area(*sides, height=m.u){more}
"""


@pytest.mark.parametrize(
    ("more", "also"),
    [
        ("", []),
        (" + area(t, t, t, t, *sides)", ["area(length, width, height): too many positional arguments"]),
        (" + area(*sides, hight=t)", ["area(length, width, height): got an unexpected keyword argument 'hight'"]),
    ],
)
def test_calls_whose_arguments_are_a_tuple_are_compared_as_far_as_the_source_tells(
    more: str, also: list[str], loaded: Any, tmp_path: Path
) -> None:
    model = loaded(tmp_path, "m.y = spread(m, t) + zzz\nreturn 0", SPREAD.format(more=more))
    with pytest.raises(CannotCompile) as failed:
        build(model, tmp_path / "fmus")
    told = [line.split(": ", 2)[2] for line in str(failed.value).splitlines()]
    assert told == [*also, 'no name "zzz"']


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ('Output("y[1]")', 'y[1]: declare the whole array with shape=, as in Output("y", shape=3)'),
        ('Output("y", shape=0)', "variable y: shape (0,); a variable is a scalar or has a length of 1 or more"),
        ('Output("y", unit="m", type=int)', "variable y: unit m; only variables of type float have a unit"),
        (
            'Output("y", type=list)',
            "type <class 'list'>: a variable is float, int, bool, str or an IntEnum with members",
        ),
    ],
)
def test_wrong_declarations_are_told_with_their_line(wrong: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "undeclared.py"
    file.write_text(MODEL.format(body="    return 0", helper="").replace('Output("y")', wrong))
    line = next(i for i, text in enumerate(file.read_text().splitlines(), 1) if text.strip() == f"{wrong},")
    with pytest.raises(ValueError) as failed:
        load_models(str(file))
    assert str(failed.value).startswith(f"{file}:{line}: ")
    assert str(failed.value).endswith(message)
    assert "undeclared" not in sys.modules


# -- at run time ------------------------------------------------------------------------------------------------------

RUNTIME = {  # case -> lines of `advance`, the line that fails, what is told, case by case of one FMU
    1: ("for i in range(1, 4):\n    m.v[i] = 7.0", "m.v[i] = 7.0", "index 3 of m.v[3]; valid: -3 to 2"),
    2: ("m.y = m.v[m.n]", "m.y = m.v[m.n]", "index 3 of m.v[3]; valid: -3 to 2"),
    3: ("m.v[-m.n - 1] = 7.0", "m.v[-m.n - 1]", "index -4 of m.v[3]; valid: -3 to 2"),
    4: ("m.table[m.n, 0] = 7.0", "m.table[m.n, 0]", "index 3 in dimension 1 of m.table[2, 4]; valid: -2 to 1"),
    5: ("m.table[1, m.n + 1] = 7.0", "m.table[1", "index 4 in dimension 2 of m.table[2, 4]; valid: -4 to 3"),
    6: ("fill(m.v, m.n + 1)", "values[i] = 7.0", "index 3 of values[3]; valid: -3 to 2"),
    7: ("m.tx[m.n + 7] = 5", "m.tx[m.n + 7]", "index 10 of m.tx[10]; valid: -10 to 9"),
    8: ("row = m.table[1]\nrow[m.n + 1] = 7.0", "row[m.n + 1]", "index 4 of row[4]; valid: -4 to 3"),
    9: ("m.v[:] = m.x", "m.v[:] = m.x", "ValueError: m.v[...] is given an array of another length"),
    10: ("m.v[: m.n + 1] = m.x[: m.n + 1]", "m.v[: m.n", "ValueError: m.v[...] is given an array of another length"),
    11: ("m.y = (1.0, 2.0)[m.n]", "m.y = (1.0", "IndexError: tuple index out of range"),
    12: ("while m.n > 2:\n    m.y += 1.0", "while m.n", "RuntimeError: the loop has not ended after 100000000 passes"),
    13: ('raise ValueError("100 % wrong")', "raise ValueError", "ValueError: 100 % wrong"),
    14: ("assert m.n < 3, 'too many'", "assert", "AssertionError: too many"),
    15: ("set_real(m, 1000000, 7.0)", "set_real(", "offset 1000000 of a record with fields at offsets below 217"),
    16: ("m.y = get_whole(m, -4)", "m.y = get_whole", "offset -4 of a record with fields at offsets below 221"),
    17: ("return 99", "", "advance returned 99; it returns 0, or a key of errors (7)"),
    18: ("return -1", "", "advance returned -1; it returns 0, or a key of errors (7)"),
    19: ("return 7", "", "advance: the gauge is broken (code 7)"),
    25: ("m.y = t / (m.u - 0.5)", "m.y = t /", "ZeroDivisionError: division by zero"),
    26: ("m.y = float(m.n % (m.n - 3))", "m.y = float(", "ZeroDivisionError: integer modulo by zero"),
    27: ("part = half(t) // float(m.n - 3)\nm.y = part", "part = ", "ZeroDivisionError: division by zero"),
}
GOOD = {  # what Python allows: negative indices from the end, slices that are cut, copies of what overlaps
    20: ("m.v[-1] = 5.0\nm.v[-m.n] = 4.0", [4.0, 0.0, 5.0]),
    21: ("m.v[1:99] = 6.0", [0.0, 6.0, 6.0]),
    22: ("m.v[:] = (1.0, 2.0, 3.0)\nm.v[1:] = m.v[:-1]", [1.0, 1.0, 2.0]),
    23: ("m.v[:] = m.w\nm.v[0] = m.counts[0]", [0.0, 0.5, 0.5]),
    24: ("for i in range(m.n):\n    for k in range(1000):\n        m.v[i] += 1.0", [1000.0, 1000.0, 1000.0]),
    28: ("m.v = m.w\nm.v[0] = 7.0\nm.v[2] = m.w[0]", [7.0, 0.5, 0.5]),
}


def by_case() -> str:
    lines = [(case, lines) for table in (RUNTIME, GOOD) for case, (lines, *_) in table.items()]
    return "\n".join(f"if m.case == {case}:\n{indent(body, '    ')}" for case, body in lines) + "\nreturn 0"


@pytest.fixture(scope="module")
def gauges(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """One model with a way to fail for each value of `case`, built in each way."""
    folder = tmp_path_factory.mktemp("gauges")
    file = folder / "failing_gauge.py"
    file.write_text(MODEL.format(body=indent(by_case(), "    "), helper=""))
    (model,) = load_models(str(file))
    yield {
        "file": file,
        "fmi2": build(model, folder).file,
        "fmi3": build(model, folder, fmi=3).file,
        "interpreted": build(model, folder / "interpreted", interpreted=True).file,
        "unchecked": build(model, folder / "unchecked", checked=False).file,
    }
    sys.modules.pop("failing_gauge")


class Driven:
    """An instance of one of these FMUs, through FMPy."""

    def __init__(self, file: Path, folder: Path, case: int) -> None:
        self.log: list[str] = []
        description = fmpy.read_model_description(str(file))
        self._vr = {v.name: v.valueReference for v in description.modelVariables}
        self._fmi3 = description.fmiVersion.startswith("3")
        instance = (FMU3Slave if self._fmi3 else FMU2Slave)(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(file), str(folder)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="gauge",
        )
        self._fmu: Any = instance
        if self._fmi3:
            self._callback = fmi3LogMessageCallback(lambda e, status, category, text: self.log.append(text.decode()))
            instance.instantiate(logMessage=self._callback, loggingOn=True)
            instance.setInt32([self._vr["case"]], [case])
            instance.enterInitializationMode()
        else:
            self._callbacks = fmi2CallbackFunctions()
            self._callbacks.logger = fmi2CallbackLoggerTYPE(
                lambda e, name, status, category, text: self.log.append(text.decode().replace("%%", "%"))
            )
            instance.instantiate(callbacks=self._callbacks, loggingOn=True)
            instance.setInteger([self._vr["case"]], [case])
            instance.setupExperiment()
            instance.enterInitializationMode()
        instance.exitInitializationMode()

    def step(self) -> None:
        if self._fmi3:
            self._fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.1)
        else:
            self._fmu.doStep(0.0, 0.1)

    def reals(self, name: str) -> list[float]:
        if self._fmi3:
            return list(self._fmu.getFloat64([self._vr[name]], 3 if name == "v" else 1))
        names = [f"{name}[{i}]" for i in (1, 2, 3)] if name == "v" else [name]
        return list(self._fmu.getReal([self._vr[one] for one in names]))

    def close(self) -> None:
        self._fmu.freeInstance()


@pytest.fixture
def drive(gauges: dict[str, Path], tmp_path: Path) -> Iterator[Any]:
    made: list[Driven] = []

    def begin(build: str, case: int) -> Driven:
        made.append(Driven(gauges[build], tmp_path / str(len(made)), case))
        return made[-1]

    yield begin
    for one in made:
        one.close()


def told(file: Path, case: int) -> str:
    _, at, message = RUNTIME[case]
    if not at:
        return message
    lines = file.read_text().splitlines()
    begin = lines.index(f"    if m.case == {case}:") if at not in "values[i] = 7.0" else 0
    line = next(i for i, text in enumerate(lines[begin:], begin + 1) if text.strip().startswith(at))
    return f"advance: failing_gauge.py:{line}: {message}"


@pytest.mark.parametrize("fmi", ["fmi2", "fmi3"])
@pytest.mark.parametrize("case", RUNTIME)
def test_what_goes_wrong_in_a_step_is_told_with_its_place(
    case: int, fmi: str, drive: Any, gauges: dict[str, Path]
) -> None:
    one = drive(fmi, case)
    with pytest.raises(FMICallException, match=r"DoStep failed with status 3 \(error\)"):
        one.step()
    assert one.log == [told(gauges["file"], case)]
    assert one.reals("energy") == [100.0]  # lies behind v in the record
    assert set(one.reals("v")) <= {0.0, 7.0}


@pytest.mark.parametrize("build", ["fmi2", "unchecked", "interpreted"])
@pytest.mark.parametrize("case", GOOD)
def test_checks_allow_what_python_allows(case: int, build: str, drive: Any) -> None:
    one = drive(build, case)
    one.step()
    assert one.reals("v") == GOOD[case][1]
    assert one.log == []


def test_without_checks_exceptions_are_told_too(drive: Any, gauges: dict[str, Path]) -> None:
    for case in (13, 14, 17):
        one = drive("unchecked", case)
        with pytest.raises(FMICallException):
            one.step()
        assert one.log == [told(gauges["file"], case)]


def test_without_checks_an_index_may_change_another_variable(drive: Any) -> None:
    one = drive("unchecked", 1)
    one.step()
    assert one.reals("energy") == [7.0]


# ---- floats in ints ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("m.n = m.n + 0.5", "m.n is an int, so the fraction of m.n + 0.5 is cut off; declare a float, or write int("),
        ("m.n = m.u", "m.n is an int, so the fraction of m.u is cut off"),
        ("m.n = m.w[1]", "m.n is an int, so the fraction of m.w[1] is cut off"),
        ("m.n += h if False else 1 / 3", "m.n is an int, so the fraction of m.n + (h if False else 1 / 3) is cut off"),
        ("m.counts[2] = -math.sqrt(m.u)", "m.counts[2] is an int, so the fraction of -math.sqrt(m.u) is cut off"),
        ("m.counts[0] = max(m.n, m.u)", "m.counts[0] is an int, so the fraction of max(m.n, m.u) is cut off"),
        *[(body, "") for body in ("m.n = int(m.u)", "m.n = round(m.u)", "m.n = math.floor(m.u)", "m.n = 7 // 2")],
        *[(body, "") for body in ("m.y = m.n", "m.n = 3", "m.n += 1", "m.v[0] = m.u")],
    ],
)
def test_a_float_that_an_int_would_cut_off_is_doubted(loaded: Any, tmp_path: Path, body: str, text: str) -> None:
    """Such kernels compile; numba and NumPy cut the fraction off without a word."""
    model = loaded(tmp_path, f"{body}\nreturn 0")
    built = build(model, tmp_path / "fmus")
    assert built.compiled and not built.fresh
    if not text:
        assert built.doubts == ()
        return
    line = line_of(tmp_path / "gauge.py", body)
    (doubt,) = built.doubts
    assert doubt.startswith(f"{tmp_path / 'gauge.py'}:{line}: {text}")
    assert build(model, tmp_path / "fmus").doubts == built.doubts, "also when nothing is built"


@pytest.mark.parametrize(
    ("body", "at"),
    [
        ("if t > 1.0:\n    return 2", "if t"),
        ("if t > 1.0:\n    return 2\nm.y = t", "m.y = t"),
        ("if t > 1.0:\n    return 2\nelif t > 0.5:\n    return 1", "if t"),
        ("for k in range(3):\n    if t > k:\n        return k", "for k"),
        ("while True:\n    if t > 1.0:\n        break\n    return 2", "while"),
        ("if t > 1.0:\n    return 2\nreturn 1", ""),
        ("if t > 1.0:\n    return 2\nelse:\n    return 1", ""),
        ("if t > 1.0:\n    return 2\nelse:\n    raise ValueError", ""),
        ("while True:\n    t += 1.0\n    if t > 5.0:\n        return 3", ""),
        ("while True:\n    for k in range(3):\n        break\n    t += 1.0\n    if t > 5.0:\n        return 3", ""),
    ],
)
def test_a_kernel_that_returns_on_some_paths_only_is_doubted(body: str, at: str, loaded: Any, tmp_path: Path) -> None:
    """Such kernels compile; a step in which nothing is returned fails."""
    helper = CALLED.format(body=indent(body, "    "), annotation=": int")
    model = loaded(tmp_path, "if decide(m, t) & 2 != 0:\n    return 7\nreturn 0", helper)
    built = build(model, tmp_path / "fmus")
    lines = (tmp_path / "gauge.py").read_text().splitlines()
    first = lines.index("def law(m, t):")
    where = [i for i, text in enumerate(lines[first:], first + 1) if at and text.strip().startswith(at)]
    text = "law ends here without a value, which it returns elsewhere; end it with return and its value"
    assert built.doubts == tuple(f"{tmp_path / 'gauge.py'}:{line}: {text}" for line in where[:1])


MAYBE = "may have no value here: assign it before"


@pytest.mark.parametrize(
    ("body", "at", "text"),
    [
        ("if t > 5.0:\n    z = 1.0\nm.y = z", "m.y", f"z {MAYBE} the if in line -2"),
        ("if t > 5.0:\n    z = 1.0\nelif h > 1.0:\n    z = 2.0\nm.y = z", "m.y", f"z {MAYBE} the if in line -4"),
        ("for k in range(3):\n    if m.v[k] > t:\n        z = k\nm.y = z", "m.y", f"z {MAYBE} the for in line -3"),
        (
            "for k in range(3):\n    if m.v[k] > t:\n        z = k\n    m.y = z",
            "m.y",
            f"z {MAYBE} the if in line -2",
        ),
        (
            "while t < m.u:\n    h *= 2.0\n    if h > 8.0:\n        z = h\nm.y = z",
            "m.y",
            f"z {MAYBE} the while in",
        ),
        ("if t > 5.0:\n    z = 1.0\nif h > 0.0:\n    m.y = z", "m.y", f"z {MAYBE} the if in line -3"),
        ("if t > 5.0:\n    z = 1.0\nz += 1.0\nm.y = z", "z +=", f"z {MAYBE} the if in line -2"),
        ("if t > 5.0:\n    z = 1.0\nm.v[int(z)] = 2.0", "m.v", f"z {MAYBE} the if in line -2"),
        (
            "match m.case:\n    case 1:\n        z = 1.0\n    case 2:\n        z = 2.0\nm.y = z",
            "m.y",
            f"z {MAYBE} the match",
        ),
        ("for k in range(3):\n    if m.u > t:\n        m.y = z\n    z = 1.0", "m.y", f"z {MAYBE} it is read"),
        # it has a value, or the same condition says whether it has
        ("if t > 5.0:\n    z = 1.0\nelse:\n    z = 2.0\nm.y = z", "", ""),
        ("if t > 5.0:\n    return 7\nelse:\n    z = 2.0\nm.y = z", "", ""),
        ("for k in range(m.n):\n    z = k\nm.y = z + k", "", ""),
        ("while True:\n    z = m.u\n    if z < t:\n        break\n    t += 1.0\nm.y = z", "", ""),
        ("for k in range(3):\n    if m.v[k] > t:\n        z = k\n        break\nelse:\n    return 7\nm.y = z", "", ""),
        (
            "found = False\nfor k in range(3):\n    if m.v[k] > t:\n        found, z = True, k\nif found:\n    m.y = z",
            "",
            "",
        ),
        (
            "best = -1\nfor k in range(3):\n    if t > k:\n        best, z = k, t\nif best < 0:\n    return 0\nm.y = z",
            "",
            "",
        ),
        ("if m.n > 2:\n    z = 1.0\nm.y = z if m.n > 2 else 0.0", "", ""),
        ("m.n = 0\nfor k in range(3):\n    if t > k:\n        m.n = 1\n        z = k\nm.y = z if m.n else 0.0", "", ""),
        ("while m.n == 0:\n    if t > h:\n        m.n = 1\n        z = t\nm.y = z", "", ""),
        ("if m.n > 2:\n    z = 1.0\nif m.n > 2 and z > 0.5:\n    m.y = 1.0", "", ""),
        ("for k in range(3):\n    if k > 0:\n        m.y = z\n    z = k", "", ""),
        ("match m.case:\n    case 1:\n        z = 1.0\n    case _:\n        z = 2.0\nm.y = z", "", ""),
        ("if (z := m.u) > t:\n    m.y = z\nm.y = z", "", ""),
    ],
)
def test_a_variable_that_some_path_reads_without_a_value_is_doubted(
    body: str, at: str, text: str, loaded: Any, tmp_path: Path
) -> None:
    """Compiled it is 0 there, where Python raises UnboundLocalError."""
    model = loaded(tmp_path, f"{body}\nreturn 0")
    if not text:
        assert doubts_of(model) == []
        return
    line = line_of(tmp_path / "gauge.py", at)
    text = re.sub(r"-(\d)$", lambda back: str(line - int(back[1])), text)
    (doubt,) = doubts_of(model)
    assert doubt.startswith(f"{tmp_path / 'gauge.py'}:{line}: {text}")


def test_a_variable_without_a_value_is_noted_by_the_build(loaded: Any, tmp_path: Path) -> None:
    built = build(loaded(tmp_path, "if t > 5.0:\n    z = 1.0\nm.y = z\nreturn 0"), tmp_path / "fmus")
    assert built.compiled
    assert [doubt.split(": ", 1)[1][:28] for doubt in built.doubts] == ["z may have no value here: as"]


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("m.y = m.n ** -1", "m.n is an int, so m.n ** -1 is one, too, mostly 0; write float(m.n) ** -1"),
        ("m.y = m.n ** 2", ""),
        ("m.y = m.u ** -1", ""),
        ("m.y = 2 ** -1", ""),
        ("m.y = float(m.n) ** -1", ""),
    ],
)
def test_a_negative_power_of_an_int_is_doubted(body: str, text: str, loaded: Any, tmp_path: Path) -> None:
    model = loaded(tmp_path, f"{body}\nreturn 0")
    told = [f"{tmp_path / 'gauge.py'}:{line_of(tmp_path / 'gauge.py', 'm.y')}: {text}"] if text else []
    assert doubts_of(model) == told


def test_shipped_models_are_not_doubted() -> None:
    for model in models_of_package("cosim_models"):
        doubts = shared_of(model) if model.kernels is None else [*doubts_of(model), *refusals_of(model)]
        assert [*degrees_of(model), *doubts] == []


def test_a_description_says_what_it_lacks_and_where(tmp_path: Path) -> None:
    (tmp_path / "bare_model.py").write_text(
        "from cosim import Model, Output\n\n\nclass Bare(Model):\n    variables = (Output('y'),)\n"
    )
    (model,) = load_models(str(tmp_path / "bare_model.py"))
    with pytest.raises(ValueError) as caught:
        build(model, tmp_path / "fmus", interpreted=True)
    needs = "Bare: a model needs a docstring, a step_size > 0 and variables"
    lacks = "this one has no docstring and no step_size > 0"
    assert str(caught.value) == f"{tmp_path / 'bare_model.py'}:4: {needs}; {lacks}"


def test_a_float_that_a_bool_would_cut_off_is_doubted(tmp_path: Path) -> None:
    kernels = "@kernel\ndef start(m):\n    m.on = m.u > 0.5\n    return 0\n\n\n"
    kernels += "@kernel\ndef advance(m, t, h):\n    m.on = 0.5 * m.u\n    return 0\n"
    variables = 'Input("u"), Output("on", type=bool)'
    body = (
        f'    """Switches."""\n\n    step_size = 0.1\n    variables = ({variables})\n    kernels = (start, advance)\n'
    )
    (tmp_path / "switching.py").write_text(
        f"from cosim import Input, Model, Output, kernel\n\n\n{kernels}\n\nclass Switching(Model):\n{body}"
    )
    (model,) = load_models(str(tmp_path / "switching.py"))
    text = "m.on is a bool, so the fraction of 0.5 * m.u is cut off; declare a float, or write a comparison"
    assert build(model, tmp_path / "fmus").doubts == (f"{tmp_path / 'switching.py'}:12: {text}",)


DECLARED = """\
from cosim import Model, Output


class Gauge(Model):
    \"\"\"A gauge.\"\"\"

    step_size = 0.1
    variables = (Output("y", unit="m", description="height"),)

    def do_step(self, t, h):
        return True
"""


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("0.1", "0.1,", "4: Gauge: step_size is (0.1,); give a number of seconds"),
        ("0.1", '"0.1"', "4: Gauge: step_size is '0.1'; give a number of seconds"),
        ("0.1", "None", "4: Gauge: step_size is None; give a number of seconds"),
        ("0.1", "True", "4: Gauge: step_size is True; give a number of seconds"),
        ("0.1", 'float("inf")', "4: Gauge: step_size is inf; give a number of seconds"),
        (
            '(Output("y", unit="m", description="height"),)',
            '[Output("y")]',
            "4: Gauge: variables is a list; give a tuple: ",
        ),
        ('unit="m"', "unit=1", "4: Gauge: unit of y is 1; give a text"),
        ('"height"', "5", "4: Gauge: description of y is 5; give a text"),
        ('"height"', r'"a\0b"', r"4: Gauge: description of y has the character '\x00', which XML cannot contain"),
        ("    def do_step(self, t, h):\n        return True\n", "", "4: Gauge: it has neither kernels nor a do_step"),
        (
            "return True\n",
            "return True\n\nraise SystemExit(0)\n",
            "13: it ends the program (sys.exit); a file of models",
        ),
    ],
)
def test_what_is_declared_as_something_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, after: str, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert DECLARED.count(before) == 1
    (tmp_path / "odd_gauge.py").write_text(DECLARED.replace(before, after))
    try:
        with pytest.raises(ValueError) as caught:
            build(load_models("odd_gauge.py")[0], tmp_path)
    finally:
        sys.modules.pop("odd_gauge", None)
    assert str(caught.value).startswith(f"odd_gauge.py:{told}")
    assert not (tmp_path / "Gauge.fmu").exists()


def test_an_angle_that_can_only_be_degrees_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    angles = 'Parameter("heading", unit="rad", start=45.0), Input("turns", unit="rad", shape=2, start=(6.28, -90.0)), '
    others = 'Parameter("bearing", unit="deg", start=90.0), Parameter("rate", unit="rad/s", start=90.0), '
    text = DECLARED.replace("import Model, Output", "import Input, Model, Output, Parameter")
    (tmp_path / "angles_gauge.py").write_text(text.replace("variables = (", f"variables = ({angles}{others}"))
    (model,) = load_models("angles_gauge.py")
    told = (
        "angles_gauge.py:4: Gauge.heading is 45 rad, more than a full turn; did you mean 0.785398 (= 45 degrees)?",
        "angles_gauge.py:4: Gauge.turns[2] is -90 rad, more than a full turn; did you mean -1.5708 (= -90 degrees)?",
    )
    for fresh in (False, True):
        (built,) = build_all([model], tmp_path)
        assert (built.fresh, built.doubts) == (fresh, told)


SHARING = """\
import random
from random import uniform

import numpy as np
from cosim import Model, Output

count = 0
seen = []
LIMITS = [1.0, 2.0]
rng = np.random.default_rng(1)


class Gauge(Model):
    \"\"\"A gauge.\"\"\"

    step_size = 0.1
    variables = (Output("y"),)
    errors = {1: "it is full"}
    CORNERS = [(0.0, 0.0)]
    heard = {}
    table = []

    def initialize(self):
        self.table = []

    def do_step(self, t, h):
        {body}
        return True
"""
SHARED, OWN = (
    "which all instances and runs of a process share",
    "declare a State or Memory, or make it an attribute of self in initialize",
)
SEEDED = (
    "differs from run to run; use normal_pair or threefry of cosim.random_numbers, which give the same in every run"
)


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ("global count", f"count is a variable of the module, {SHARED}; {OWN}"),
        ("seen.append(t)", f"seen is a list of the module, {SHARED}; {OWN}"),
        ("self.heard[t] = h", f"self.heard is a dict of the class, {SHARED}; {OWN}"),
        ("self.m.y = random.random()", f"random.random {SEEDED}"),
        ("self.m.y = uniform(0.0, 1.0)", f"uniform {SEEDED}"),
        ("self.m.y = np.random.rand()", f"np.random.rand {SEEDED}"),
        ("self.rng = random.Random()", f"random.Random {SEEDED}"),
        ("self.rng = random.Random(5)", ""),
        ("self.m.y = np.random.default_rng(3).normal() + rng.normal()", ""),
        ("random.seed(2); self.m.y = random.random()", ""),
        ("self.table.append(self.CORNERS[0][0] + LIMITS[1])", ""),
        ("seen = []; seen.append(t)", ""),
    ],
)
def test_what_instances_of_a_plain_class_share_is_noted(body: str, told: str, tmp_path: Path) -> None:
    file = tmp_path / "sharing_gauge.py"
    file.write_text(SHARING.replace("{body}", body))
    (model,) = load_models(str(file))
    try:
        doubts = build(model, tmp_path).doubts
    finally:
        del sys.modules["sharing_gauge"]
    line = next(i for i, text in enumerate(file.read_text().splitlines(), 1) if text.strip() == body)
    assert doubts == ((f"{file}:{line}: {told}",) if told else ())


def test_what_is_declared_as_it_must_be(tmp_path: Path) -> None:
    (tmp_path / "right_gauge.py").write_text(DECLARED)
    (model,) = load_models(str(tmp_path / "right_gauge.py"))
    assert build(model, tmp_path).file == tmp_path / "Gauge.fmu"
