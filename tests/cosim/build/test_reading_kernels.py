"""Sources of kernels are read as by Python's own means, which take longer."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cosim import frames, packets
from cosim.build.faults import _parsed
from cosim.build.paths import walk
from tests.cosim.build import test_wrong_models

SAMPLES = '''
from functools import cache

@cache
@cache
def decorated(a, b=(
    1, 2
)):
    """A docstring

that is not indented."""
# nor is this comment

    return a  # the end

# of another one
def long(
    first: int,
    *more: float,
) -> float:
    while first:
        first -= 1
    return first + \\
2

class Of:
    @staticmethod
    def inner(x):
        def within(y):
            return y
        return within(x)
    other = 3

def one_line(x): return x
def last(x):
    match x:
        case [1, *_] | {"a": 2}:
            return lambda z: [one for one in z]
    try:
        (y := x)
    except ValueError as error:
        raise TypeError(f"{y}") from error
    return -x ** 2 if not x else x < 3 < 4'''


def samples(folder: Path) -> list[Callable[..., Any]]:
    file = folder / "samples.py"
    file.write_text(SAMPLES, encoding="utf-8")
    found: dict[str, Any] = {}
    exec(compile(SAMPLES, str(file), "exec"), found)
    names = ("long", "one_line", "last")
    return [inspect.unwrap(found["decorated"]), found["Of"].inner, *(found[name] for name in names)]


def as_by_python(function: Callable[..., Any]) -> ast.Module:
    lines, first = inspect.getsourcelines(function)
    return ast.increment_lineno(ast.parse(textwrap.dedent("".join(lines))), first - 1)


def described(tree: ast.Module) -> list[tuple[str, int]]:
    nodes = ast.walk(tree)
    return [(ast.dump(node), getattr(node, "lineno", 0)) for node in nodes if not isinstance(node, _LEFT_OUT)]


_LEFT_OUT = (ast.expr_context, ast.boolop, ast.operator, ast.unaryop, ast.cmpop)


def test_definitions_are_those_of_the_file(tmp_path: Path) -> None:
    modules = (frames, packets, test_wrong_models)
    every = [getattr(one, "py_func", one) for module in modules for one in vars(module).values()]
    shipped = [one for one in every if inspect.isfunction(one) and one.__name__ != "<lambda>"]
    assert len(shipped) > 100
    for function in (*samples(tmp_path), *shipped):
        assert described(_parsed(function)) == described(as_by_python(function)), function


def test_nodes_come_in_pythons_order() -> None:
    for text in (SAMPLES, Path(test_wrong_models.__file__).read_text(encoding="utf-8")):
        tree = ast.parse(text)
        assert [id(one) for one in walk(tree)] == [id(one) for one in ast.walk(tree) if not isinstance(one, _LEFT_OUT)]


def test_what_has_no_source_is_not_read() -> None:
    found: dict[str, Any] = {}
    exec("def nowhere(x):\n    return x", found)
    with pytest.raises(OSError, match="could not get source code"):
        _parsed(found["nowhere"])
    with pytest.raises(TypeError):
        _parsed(len)
