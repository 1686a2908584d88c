"""Formulas of temporal logic: reading, hand-computed values, and a brute-force oracle over whole traces."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_master.verdict.monitors.formula import Binary, Formula, FormulaError, Node, Value, Window, parse
from cosim_master.verdict.monitors.temporal import Evaluation

X = Binary(">", (Value("x"), Value(0.0)))

# ---- reading -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("x < 2", Binary("<", (Value("x"), Value(2.0)))),
        ("not a > 1 or b > 1 and c > 1",
         Binary("or", (Binary("not", (Binary(">", (Value("a"), Value(1.0))),)),
                       Binary("and", (Binary(">", (Value("b"), Value(1.0))), Binary(">", (Value("c"), Value(1.0)))))))),
        ("1 + 2 * -x == abs(y) / 2 - 1",
         Binary("==", (Binary("+", (Value(1.0), Binary("*", (Value(2.0), Binary("negative", (Value("x"),)))))),
                       Binary("-", (Binary("/", (Binary("abs", (Value("y"),)), Value(2.0))), Value(1.0)))))),
        ("always[0,1.5] x > 0 -> true",
         Binary("->", (Window("always", 0.0, 1.5, (Binary(">", (Value("x"), Value(0.0))),)), Value(True)))),
        ("(x > 0 since y > 0) <-> once x > 0",
         Binary("<->", (Window("since", 0.0, math.inf, (X, Binary(">", (Value("y"), Value(0.0))))),
                        Window("once", 0.0, math.inf, (X,))))),
    ],
)  # fmt: skip
def test_precedence(text: str, tree: Node) -> None:
    assert [node for _, node in parse(text).conjuncts] == [tree]


def test_conjuncts_are_judged_one_by_one() -> None:
    formula = parse("x > 0 and  (y > 0 and z > 0)\n and eventually[0,2] x > 1")
    assert [text for text, _ in formula.conjuncts] == ["x > 0", "(y > 0 and z > 0)", "eventually[0,2] x > 1"]
    assert (formula.signals, formula.horizon) == (("x", "y", "z"), 2.0)
    assert [text for text, _ in parse("(x > 0 and y > 0)").conjuncts] == ["(x > 0 and y > 0)"]


def test_horizons_add_up() -> None:
    assert parse("eventually[0,2] (always[1,3] x > 0 or once[0,9] x > 0) and once[0,9] x > 0").horizon == 5.0
    assert parse("eventually[0,2] (always[1,3] x > 0 or once[0,9] x > 0) and x > 0 until[0,4] x > 1").horizon == 9.0


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "the end of the formula: a signal, a number or a formula must be here"),
        ("x", '"x" at character 1: a truth value must be here'),
        ("x > 1 > 0", '">" at character 7: two comparisons must be connected by and'),
        ("x > 1 y > 1", '"y" at character 7: the formula must end here, or go on with an operator'),
        ("eventually x > 1", '"x" at character 12: eventually looks at the future: it needs an interval'),
        ("x > 0 until x > 1", "until looks at the future: it needs an interval, such as until[0,5]"),
        ("always[2,1] x > 1", '"[" at character 7: the interval from 2 to 1 s ends before it begins'),
        ("always[-1,1] x > 1", '"-" at character 8: a time in s must be here, 0 or more'),
        ("always[0 1] x > 1", '"1" at character 10: "," must be here'),
        ("not x", '"x" at character 5: a truth value must be here'),
        ("(x > 1) + 1 > 0", '"(" at character 1: a number must be here, and this is a truth value'),
        ("x > 1 and y", '"y" at character 11: a truth value must be here'),
        ("x > 1 -> 2", '"2" at character 10: a truth value must be here'),
        ("aps(x) > 1", '"aps" at character 1: there is no such function; did you mean "abs"?'),
        ("min(x) > 1", '"min" at character 1: needs 2 arguments and has 1'),
        ("x > $", '"$" at character 5 has no meaning in a formula'),
        ("(x > 1", 'the end of the formula: ")" must be here'),
        ("x > and", '"and" at character 5: a signal, a number or a formula must be here'),
    ],
)  # fmt: skip
def test_a_formula_that_cannot_be_read_says_where(text: str, problem: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert problem in str(caught.value)


# ---- values --------------------------------------------------------------------------------------------------------


def evaluated(text: str, base: float = 1.0, **signals: list[float]) -> tuple[list[int], list[bool], list[float]]:
    """Instants, truth values and robustness of a formula with one conjunct, all instants given at once."""
    ((_, node),) = parse(text).conjuncts
    columns: dict[str, Any] = {name: np.array(values, float)[:, None] for name, values in signals.items()}
    steps = np.arange(len(next(iter(columns.values()))))
    at, holds, robustness = Evaluation(node, base).push(steps, columns)
    return at.tolist(), holds[:, 0].tolist(), robustness[:, 0].tolist()


@pytest.mark.parametrize(
    ("text", "at", "holds", "robustness"),
    [  # x = 3, 1, 2, 5, 0
        ("x > 1", [0, 1, 2, 3, 4], [True, False, True, True, False], [2, 0, 1, 4, -1]),
        ("x >= 1", [0, 1, 2, 3, 4], [True, True, True, True, False], [2, 0, 1, 4, -1]),
        ("not x > 1", [0, 1, 2, 3, 4], [False, True, False, False, True], [-2, 0, -1, -4, 1]),
        ("x == 2", [0, 1, 2, 3, 4], [False, False, True, False, False], [-1, -1, 0, -3, -2]),
        ("x != 2", [0, 1, 2, 3, 4], [True, True, False, True, True], [1, 1, 0, 3, 2]),
        ("not x == 2", [0, 1, 2, 3, 4], [True, True, False, True, True], [1, 1, 0, 3, 2]),
        ("always[0,1] x >= 1", [0, 1, 2, 3], [True, True, True, False], [0, 0, 1, -1]),
        ("always[1,2] x >= 1", [0, 1, 2], [True, True, False], [0, 1, -1]),
        ("eventually[0,2] x > 4", [0, 1, 2], [False, True, True], [-1, 1, 1]),
        ("historically[0,1] x >= 2", [0, 1, 2, 3, 4], [True, False, False, True, False], [1, -1, -1, 0, -2]),
        ("once[1,2] x > 2", [0, 1, 2, 3, 4], [False, True, True, False, True], [-math.inf, 1, 1, 0, 3]),
        ("historically[1,1] x > 2", [0, 1, 2, 3, 4], [True, True, False, False, True], [math.inf, 1, -1, 0, 3]),
        ("historically x >= 1", [0, 1, 2, 3, 4], [True, True, True, True, False], [2, 0, 0, 0, -1]),
        ("once x > 4", [0, 1, 2, 3, 4], [False, False, False, True, True], [-1, -1, -1, 1, 1]),
        ("x > 0 since x == 1", [0, 1, 2, 3, 4], [False, True, True, True, False], [-2, 0, 0, 0, 0]),
        ("x > 0 until[0,2] x == 2", [0, 1, 2], [True, True, True], [0, 0, 0]),
        ("x > 1 until[0,2] x == 2", [0, 1, 2], [False, False, True], [0, 0, 0]),
        ("x > 1 -> eventually[0,1] x > 2", [0, 1, 2, 3], [True, True, True, True], [1, 0, 3, 3]),
        ("x > 1 <-> x > 2", [0, 1, 2, 3, 4], [True, True, False, True, True], [1, 0, 0, 3, 1]),
        ("min(x, 2) + abs(-1) * sqrt(4) - hypot(3, 4) / 5 == 3", [0, 1, 2, 3, 4],
         [True, False, True, True, False], [0, -1, 0, 0, -2]),
        ("max(x, 2) > 2", [0, 1, 2, 3, 4], [True, False, False, True, False], [1, 0, 0, 3, 0]),
    ],
)  # fmt: skip
def test_values_by_hand(text: str, at: list[int], holds: list[bool], robustness: list[float]) -> None:
    assert evaluated(text, x=[3, 1, 2, 5, 0]) == (at, holds, robustness)


def test_an_interval_counts_communication_points() -> None:
    """[0, 0.3] s at 0.1 s: the ends belong to it, although 3 * 0.1 is more than 0.3 in floating point."""
    assert evaluated("once[0,0.3] x > 0", 0.1, x=[1, 0, 0, 0, 0])[1] == [True, True, True, True, False]
    with pytest.raises(ValueError, match=r"once\[0.01,0.02\] contains no communication point: they are 0.1 s apart"):
        evaluated("once[0.01,0.02] x > 0", 0.1, x=[1])


def test_nan_makes_comparisons_false() -> None:
    assert evaluated("x > 0", x=[math.nan]) == ([0], [False], [-math.inf])
    assert evaluated("sqrt(x) <= 0", x=[-1.0])[1:] == ([False], [-math.inf])


# ---- the definition, evaluated over a whole trace --------------------------------------------------------------------


def truth(node: Node, k: int, steps: list[int], trace: dict[str, list[float]], known: dict[Any, Any]) -> Any:
    """Truth and robustness at instant number k by the definition; None if the trace is too short to tell."""
    if (id(node), k) not in known:
        known[id(node), k] = by_definition(node, k, steps, trace, known)
    return known[id(node), k]


def by_definition(node: Node, k: int, steps: list[int], trace: dict[str, list[float]], known: dict[Any, Any]) -> Any:
    i = steps[k]
    if isinstance(node, Window):
        future = node.operator in ("always", "eventually", "until")
        if future and i + node.end > steps[-1]:
            return None
        low, high = (i + node.begin, i + node.end) if future else (i - node.end, i - node.begin)
        points = [j for j, step in enumerate(steps) if low <= step <= high]
        values = []
        for j in points:
            value = truth(node.operands[-1], j, steps, trace, known)
            if value is None:
                return None
            if len(node.operands) == 2:
                between = range(k, j) if future else range(j + 1, k + 1)
                held = [truth(node.operands[0], one, steps, trace, known) for one in between]
                if None in held:
                    return None
                value = (
                    all(one[0] for one in held if one) and value[0],
                    min([value[1], *(one[1] for one in held if one)]),
                )
            values.append(value)
        if node.operator in ("always", "historically"):
            return all(one for one, _ in values), min((one for _, one in values), default=math.inf)
        return any(one for one, _ in values), max((one for _, one in values), default=-math.inf)
    assert isinstance(node, Binary)
    if node.operator == ">=":
        name, limit = node.operands
        assert isinstance(name, Value) and isinstance(limit, Value)
        apart = trace[str(name.value)][k] - float(limit.value)
        return apart >= 0, apart
    found = [truth(one, k, steps, trace, known) for one in node.operands]
    if None in found:
        return None
    (a, ra), *rest = [one for one in found if one]
    if node.operator == "not":
        return not a, -ra
    ((b, rb),) = rest
    return {
        "and": (a and b, min(ra, rb)),
        "or": (a or b, max(ra, rb)),
        "->": (not a or b, max(-ra, rb)),
        "<->": (a == b, min(max(-ra, rb), max(-rb, ra))),
    }[node.operator]


def trees(depth: int = 2) -> st.SearchStrategy[Node]:
    atoms = st.builds(
        lambda name, limit: Binary(">=", (Value(name), Value(float(limit)))), st.sampled_from("xy"), st.integers(-2, 2)
    )
    if depth == 0:
        return atoms
    inner = trees(depth - 1)
    interval = st.tuples(st.integers(0, 3), st.integers(0, 3)).map(lambda pair: (float(min(pair)), float(max(pair))))
    unary, two = st.sampled_from(["always", "eventually", "historically", "once"]), st.sampled_from(["until", "since"])
    past = st.sampled_from(["historically", "once"])
    return st.one_of(
        atoms,
        st.builds(lambda o, a: Binary(o, (a,)), st.just("not"), inner),
        st.builds(lambda o, a, b: Binary(o, (a, b)), st.sampled_from(["and", "or", "->", "<->"]), inner, inner),
        st.builds(lambda o, i, a: Window(o, *i, (a,)), unary, interval, inner),
        st.builds(lambda o, b, a: Window(o, float(b), math.inf, (a,)), past, st.integers(0, 2), inner),
        st.builds(lambda o, i, a, b: Window(o, *i, (a, b)), two, interval, inner, inner),
        st.builds(lambda b, a, c: Window("since", float(b), math.inf, (a, c)), st.integers(0, 2), inner, inner),
    )


@settings(max_examples=60)
@given(
    node=trees(),
    gaps=st.lists(st.integers(1, 2), min_size=3, max_size=14),
    values=st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=15, max_size=15),
    cuts=st.sets(st.integers(1, 13), max_size=4),
)
def test_online_values_are_those_of_the_definition(
    node: Node, gaps: list[int], values: list[tuple[int, int]], cuts: set[int]
) -> None:
    """In chunks of any size, at uneven instants, and through a checkpoint after each chunk."""
    steps = np.cumsum([0, *gaps]).tolist()
    trace = {name: [float(pair[n]) for pair in values[: len(steps)]] for n, name in enumerate("xy")}
    table: dict[Any, Any] = {}
    expected = {steps[k]: truth(node, k, steps, trace, table) for k in range(len(steps))}
    evaluation, found = Evaluation(node, 1.0), {}
    borders = [0, *sorted(one for one in cuts if one < len(steps)), len(steps)]
    for begin, end in pairwise(borders):
        columns = {name: np.array(of[begin:end])[:, None] for name, of in trace.items()}
        at, holds, robustness = evaluation.push(np.array(steps[begin:end]), columns)
        found |= {int(k): (bool(one[0]), float(rob[0])) for k, one, rob in zip(at, holds, robustness, strict=True)}
        memory = json.loads(json.dumps(evaluation.memory()))
        evaluation = Evaluation(node, 1.0)
        evaluation.recall(memory)
    horizon = Formula("", (("", node),), ()).horizon
    assert {k for k in steps if k + horizon <= steps[-1]} <= found.keys()
    assert found == {k: expected[k] for k in found}
