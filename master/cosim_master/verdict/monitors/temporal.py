"""Formulas of signal temporal logic evaluated in discrete time, as the run goes on.

A formula is evaluated over the communication points of a run: a temporal operator with the interval [a, b] looks at all
points from a to b seconds after (or before) the current one. Its value at an instant is known as soon as the last point
on which it depends has been passed; instants whose value is not known at the end of the run are not judged.

Each node of the tree is a `_Stream`: it takes chunks of instants and returns the instants whose values have become
known, in order. Its values are a truth value and the robustness (Fainekos and Pappas 2009): the distance from the
border between true and false in the unit of the compared signals, positive if the formula holds. On the border itself,
which may belong to either side, the robustness is 0; truth values are therefore computed beside it, and decide alone.

All values have columns, one for each drone that the formula speaks of. A value of one column stands for all.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any, Protocol, TypeAlias

import numpy as np

from cosim_master.verdict.monitors.formula import Binary, Node, Value, Window

__all__ = ["Block", "Evaluation"]

Array: TypeAlias = np.ndarray[Any, Any]
Block: TypeAlias = tuple[Array, Array, Array]
"""Instants as numbers of base steps (n,), truth values (n, m) and robustness (n, m)."""
Signals: TypeAlias = Mapping[str, Array]

_NONE = np.zeros(0, np.int64)


class Evaluation:
    """The evaluation of one formula.

    Args:
        base: length of a base step, s.

    Raises:
        ValueError: an interval contains no communication point.
    """

    def __init__(self, node: Node, base: float) -> None:
        self._stream = _stream(node, base)

    def push(self, steps: Array, signals: Signals) -> Block:
        """Adds instants; returns those whose values have become known.

        Args:
            steps: (n,) rising numbers of base steps.
            signals: (n, m) or (n, 1) values by name.
        """
        return self._stream.push(steps, signals)

    def memory(self) -> list[Any]:
        """Returns plain values for a checkpoint."""
        return [stream.memory() for stream in _all(self._stream)]

    def recall(self, memory: list[Any]) -> None:
        """Restores `memory`."""
        for stream, values in zip(_all(self._stream), memory, strict=True):
            stream.recall(values)


class _Stream(Protocol):
    """A node of the tree."""

    operands: tuple[_Stream, ...]

    @property
    def known(self) -> int:
        """The base step up to which the values of all communication points have been returned; -1: of none."""

    def push(self, steps: Array, signals: Signals) -> Block: ...
    def memory(self) -> Any: ...
    def recall(self, memory: Any) -> None: ...


def _all(stream: _Stream) -> list[_Stream]:
    return [stream, *(one for operand in stream.operands for one in _all(operand))]


def _stream(node: Node, base: float) -> _Stream:
    if isinstance(node, Window):
        begin, end = int(np.ceil(node.begin / base - 1e-9)), node.end / base + 1e-9
        if end < begin:
            text = f"{node.operator}[{node.begin:g},{node.end:g}] contains no communication point: they are {base:g} s"
            raise ValueError(f"{text} apart")
        last = int(end) if np.isfinite(end) else None
        operands = tuple(_stream(one, base) for one in node.operands)
        if node.operator in ("until", "since"):
            return _Until(node.operator == "until", begin, last, operands)
        every, future = node.operator in ("always", "historically"), node.operator in ("always", "eventually")
        return _Extreme(every, future, begin, last, operands)
    if isinstance(node, Binary) and node.operator in _LOGIC:
        return _Logic(node.operator, tuple(_stream(one, base) for one in node.operands))
    return _Atom(node)


# ---- without memory --------------------------------------------------------------------------------------------------


class _Atom:
    """A comparison, or a truth value."""

    operands: tuple[_Stream, ...] = ()

    def __init__(self, node: Node) -> None:
        self._node = node
        self.known = -1

    def push(self, steps: Array, signals: Signals) -> Block:
        node = self._node
        self.known = int(steps[-1]) if len(steps) else self.known
        if isinstance(node, Value):
            holds = np.full((len(steps), 1), bool(node.value))
            return steps, holds, np.where(holds, np.inf, -np.inf)
        assert isinstance(node, Binary)
        left, right = (_number(one, len(steps), signals) for one in node.operands)
        with np.errstate(invalid="ignore"):
            holds = _COMPARED[node.operator](left, right)
            apart = np.abs(left - right)
            robustness = {"==": lambda: -apart, "!=": lambda: apart}.get(node.operator, lambda: None)()
            if robustness is None:
                robustness = right - left if node.operator[0] == "<" else left - right
        return steps, holds, np.where(np.isnan(robustness), np.where(holds, 0.0, -np.inf), robustness)

    def memory(self) -> Any:
        return self.known

    def recall(self, memory: Any) -> None:
        self.known = memory


_COMPARED = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
}
_NUMBERS: Mapping[str, Any] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "negative": np.negative,
    "abs": np.abs, "sqrt": np.sqrt, "min": np.minimum, "max": np.maximum, "hypot": np.hypot,
}  # fmt: skip


def _number(node: Node, n: int, signals: Signals) -> Array:
    if isinstance(node, Value):
        return signals[node.value] if isinstance(node.value, str) else np.full((n, 1), float(node.value))
    assert isinstance(node, Binary)
    with np.errstate(all="ignore"):  # what is not a number makes comparisons false
        found: Array = _NUMBERS[node.operator](*(_number(one, n, signals) for one in node.operands))
    return found


_LOGIC = ("and", "or", "not", "->", "<->")


class _Logic:
    """A logical operation on operands that may become known at different times."""

    def __init__(self, operator: str, operands: tuple[_Stream, ...]) -> None:
        self._operator, self.operands = operator, operands
        self._waiting: list[Block | None] = [None] * len(operands)

    @property
    def known(self) -> int:
        return min(one.known for one in self.operands)

    def push(self, steps: Array, signals: Signals) -> Block:
        known = [
            _joined(before, one.push(steps, signals)) for before, one in zip(self._waiting, self.operands, strict=True)
        ]
        n = min(len(block[0]) for block in known)
        self._waiting = [_cut(block, n) for block in known]
        at = known[0][0][:n]
        holds, robustness = [block[1][:n] for block in known], [block[2][:n] for block in known]
        if self._operator == "not":
            return at, ~holds[0], -robustness[0]
        if self._operator == "and":
            return at, holds[0] & holds[1], np.minimum(*robustness)
        if self._operator == "or":
            return at, holds[0] | holds[1], np.maximum(*robustness)
        there = ~holds[0] | holds[1], np.maximum(-robustness[0], robustness[1])
        if self._operator == "->":
            return at, *there
        return at, there[0] & (~holds[1] | holds[0]), np.minimum(there[1], np.maximum(-robustness[1], robustness[0]))

    def memory(self) -> Any:
        return [_packed(one) for one in self._waiting]

    def recall(self, memory: Any) -> None:
        self._waiting = [_unpacked(one) for one in memory]


# ---- with memory -----------------------------------------------------------------------------------------------------


class _Extreme:
    """`always` and `historically` (every), `eventually` and `once`: the least or greatest value of a window.

    A window slides as a queue of two stacks: the values of the front one are extremes from each of its instants to its
    end, so that a step costs the same whatever the length of the window.
    """

    def __init__(self, every: bool, future: bool, begin: int, end: int | None, operands: tuple[_Stream, ...]) -> None:
        self.operands = operands
        self._future, self._begin, self._end = future, begin, end
        self._truth: np.ufunc
        self._extreme: np.ufunc
        self._truth, self._extreme = (np.logical_and, np.minimum) if every else (np.logical_or, np.maximum)
        self._empty = every, np.inf if every else -np.inf
        self._front: list[tuple[int, Array, Array]] = []
        self._back: list[tuple[int, Array, Array]] = []
        self._of_back: tuple[Array, Array] | None = None
        self._coming: Block | None = None  # values that have not entered the window yet
        self._due: Array = _NONE  # instants that have no value yet

    @property
    def known(self) -> int:
        return self.operands[0].known - (self._end or 0 if self._future else 0)

    def push(self, steps: Array, signals: Signals) -> Block:
        at, holds, robustness = _joined(self._coming, self.operands[0].push(steps, signals))
        new = len(self._coming[0]) if self._coming is not None else 0
        due = np.concatenate([self._due, at[new:]])
        known = self.operands[0].known
        found_holds, found_robustness, entered, done = [], [], 0, 0
        for instant in map(int, due):
            low, high = self._window(instant)
            if self._future and high > known:
                break
            while entered < len(at) and at[entered] <= high:
                self._enter(int(at[entered]), holds[entered], robustness[entered])
                entered += 1
            self._leave(low)
            truth, extreme = self._value(holds.shape[1:])
            found_holds.append(truth)
            found_robustness.append(extreme)
            done += 1
        self._due, self._coming = due[done:], _cut((at, holds, robustness), entered)
        shape = (0, *holds.shape[1:])
        return (
            due[:done],
            np.array(found_holds, bool) if done else np.zeros(shape, bool),
            np.array(found_robustness) if done else np.zeros(shape),
        )

    def _window(self, instant: int) -> tuple[int, int]:
        if self._future:
            assert self._end is not None
            return instant + self._begin, instant + self._end
        return (-1 if self._end is None else instant - self._end), instant - self._begin

    def _enter(self, at: int, holds: Array, robustness: Array) -> None:
        """Adds a value at the end of the window."""
        before = self._of_back
        if before is None:
            self._of_back = holds, robustness
        else:
            self._of_back = self._truth(before[0], holds), self._extreme(before[1], robustness)
        if self._end is not None:  # without an end, nothing ever leaves
            self._back.append((at, holds, robustness))

    def _leave(self, low: int) -> None:
        """Removes the values before `low` from the window."""
        if self._end is None:
            return
        while self._front and self._front[-1][0] < low:
            self._front.pop()
        if not self._front and self._back and self._back[0][0] < low:
            for at, holds, robustness in reversed([one for one in self._back if one[0] >= low]):
                if self._front:
                    _, later, lesser = self._front[-1]
                    holds, robustness = self._truth(holds, later), self._extreme(robustness, lesser)
                self._front.append((at, holds, robustness))
            self._back, self._of_back = [], None

    def _value(self, shape: tuple[int, ...]) -> tuple[Array, Array]:
        parts = [self._front[-1][1:]] if self._front else []
        parts += [] if self._of_back is None else [self._of_back]
        if not parts:
            return np.full(shape, self._empty[0]), np.full(shape, self._empty[1])
        if len(parts) == 1:
            return parts[0]
        return self._truth(parts[0][0], parts[1][0]), self._extreme(parts[0][1], parts[1][1])

    def memory(self) -> Any:
        of_back = None if self._of_back is None else (_NONE, self._of_back[0][None], self._of_back[1][None])
        return [
            _packed(_stacked(self._front)),
            _packed(_stacked(self._back)),
            _packed(of_back),
            _packed(self._coming),
            self._due.tolist(),
        ]

    def recall(self, memory: Any) -> None:
        front, back, of_back, coming = (_unpacked(one) for one in memory[:4])
        self._front, self._back = _unstacked(front), _unstacked(back)
        self._of_back = None if of_back is None else (of_back[1][0], of_back[2][0])
        self._coming, self._due = coming, np.array(memory[4], np.int64)


class _Until:
    """`until` and `since`: the second operand holds at a point of the window, and the first one up to it.

    `a until[l,h] b` at t: b holds at a point t' from t+l to t+h, and a holds at all points from t on before t'.
    `a since[l,h] b` at t: b held at a point t' from t-h to t-l, and a has held at all points after t', up to t.
    Each instant costs as much as its window is long.
    """

    def __init__(self, future: bool, begin: int, end: int | None, operands: tuple[_Stream, ...]) -> None:
        self._future, self._begin, self._end, self.operands = future, begin, end, operands
        self._both = _Pair(operands)
        self._kept: Block | None = None  # the two operands side by side, as far as windows need them
        self._due: Array = _NONE
        self._lasting: Block | None = None  # without an end: the value at the last instant

    @property
    def known(self) -> int:
        return min(one.known for one in self.operands) - (self._end or 0 if self._future else 0)

    def push(self, steps: Array, signals: Signals) -> Block:
        at, first, second = self._both.push(steps, signals)
        if self._end is None and self._begin == 0:
            return self._forever(at, first, second)
        before = self._kept
        joined = at if before is None else np.concatenate([before[0], at])
        sides = [_side_by_side(first), _side_by_side(second)]
        width = max(side.shape[1] for side in sides)
        new = np.stack([np.broadcast_to(side, (len(at), width, 2)) for side in sides], axis=1)
        values = new if before is None else np.concatenate([before[2], new])
        due = np.concatenate([self._due, at])
        done, out = 0, []
        for instant in map(int, due):
            if self._future:
                assert self._end is not None
                if instant > self.known:
                    break
                out.append(self._ahead(joined, values, instant))
            else:
                out.append(self._behind(joined, values, instant))
            done += 1
        self._due = due[done:]
        oldest = self._oldest(joined)
        self._kept = joined[oldest:], np.zeros((len(joined) - oldest, 1), bool), values[oldest:]
        known = np.array(out) if out else np.zeros((0, width, 2))
        return due[:done], known[:, :, 0] > 0.0, known[:, :, 1]

    def _oldest(self, joined: Array) -> int:
        """Returns the first point that later windows need."""
        if self._future:
            return int(np.searchsorted(joined, self._due[0])) if len(self._due) else len(joined)
        if self._end is None or not len(joined):
            return 0
        return int(np.searchsorted(joined, joined[-1] - self._end))

    def _ahead(self, at: Array, values: Array, instant: int) -> Array:
        assert self._end is not None
        start = int(np.searchsorted(at, instant))
        low = int(np.searchsorted(at, instant + self._begin))
        high = int(np.searchsorted(at, instant + self._end, side="right"))
        if low >= high:
            return np.full(values.shape[2:], -np.inf)
        held = np.minimum.accumulate(values[start:high, 0], axis=0)
        held = np.concatenate([np.full((1, *held.shape[1:]), np.inf), held[:-1]])
        best: Array = np.minimum(values[low:high, 1], held[low - start :]).max(axis=0)
        return best

    def _behind(self, at: Array, values: Array, instant: int) -> Array:
        now = int(np.searchsorted(at, instant, side="right"))
        low = 0 if self._end is None else int(np.searchsorted(at, instant - self._end))
        high = int(np.searchsorted(at, instant - self._begin, side="right"))
        if low >= high:
            return np.full(values.shape[2:], -np.inf)
        held = np.minimum.accumulate(values[low:now, 0][::-1], axis=0)[::-1]
        held = np.concatenate([held[1:], np.full((1, *held.shape[1:]), np.inf)])
        best: Array = np.minimum(values[low:high, 1], held[: high - low]).max(axis=0)
        return best

    def _forever(self, at: Array, first: Block, second: Block) -> Block:
        holds, robustness = [], []
        for j in range(len(at)):
            truth, extreme = second[1][j], second[2][j]
            if self._lasting is not None:
                truth = truth | (first[1][j] & self._lasting[1][0])
                extreme = np.maximum(extreme, np.minimum(first[2][j], self._lasting[2][0]))
            self._lasting = at[j : j + 1], np.atleast_1d(truth)[None], np.atleast_1d(extreme)[None]
            holds.append(self._lasting[1][0])
            robustness.append(self._lasting[2][0])
        if not holds:
            return at, np.zeros((0, 1), bool), np.zeros((0, 1))
        return at, np.array(holds), np.array(robustness)

    def memory(self) -> Any:
        return [self._both.memory(), _packed(self._kept), self._due.tolist(), _packed(self._lasting)]

    def recall(self, memory: Any) -> None:
        self._both.recall(memory[0])
        self._kept, self._lasting = _unpacked(memory[1]), _unpacked(memory[3])
        self._due = np.array(memory[2], np.int64)


class _Pair:
    """Two streams at the instants at which both are known."""

    def __init__(self, operands: tuple[_Stream, ...]) -> None:
        self._operands = operands
        self._waiting: list[Block | None] = [None, None]

    def push(self, steps: Array, signals: Signals) -> tuple[Array, Block, Block]:
        known = [
            _joined(before, one.push(steps, signals)) for before, one in zip(self._waiting, self._operands, strict=True)
        ]
        n = min(len(block[0]) for block in known)
        self._waiting = [_cut(block, n) for block in known]
        first, second = ((block[0][:n], block[1][:n], block[2][:n]) for block in known)
        return first[0], first, second

    def memory(self) -> Any:
        return [_packed(one) for one in self._waiting]

    def recall(self, memory: Any) -> None:
        self._waiting = [_unpacked(one) for one in memory]


# ---- blocks ----------------------------------------------------------------------------------------------------------


def _side_by_side(block: Block) -> Array:
    """Returns truth values (as 1 and -1) and robustness as one array (n, m, 2): min and max then apply to both."""
    return np.stack([np.where(block[1], 1.0, -1.0), block[2]], axis=2)


def _joined(before: Block | None, block: Block) -> Block:
    if before is None or not len(before[0]):
        return block
    if not len(block[0]):
        return before
    at, holds, robustness = (np.concatenate([one, other]) for one, other in zip(before, block, strict=True))
    return at, holds, robustness


def _cut(block: Block, n: int) -> Block | None:
    """Returns a copy of the instants from number n on; None if there are none."""
    if n >= len(block[0]):
        return None
    return block[0][n:].copy(), block[1][n:].copy(), block[2][n:].copy()


def _stacked(rows: list[tuple[int, Array, Array]]) -> Block | None:
    if not rows:
        return None
    return np.array([at for at, *_ in rows]), np.array([one for _, one, _ in rows]), np.array([one for *_, one in rows])


def _unstacked(block: Block | None) -> list[tuple[int, Array, Array]]:
    return [] if block is None else [(int(at), *rest) for at, *rest in zip(*block, strict=True)]


def _packed(block: Block | None) -> Any:
    """Returns a block as text, since windows may contain millions of numbers."""
    if block is None:
        return None
    return [
        [
            one.dtype.str,
            list(one.shape),
            base64.b64encode(zlib.compress(np.ascontiguousarray(one).tobytes(), 1)).decode(),
        ]
        for one in block
    ]


def _unpacked(packed: Any) -> Block | None:
    if packed is None:
        return None
    at, holds, robustness = (
        np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=kind).reshape(shape).copy()
        for kind, shape, text in packed
    )
    return at, holds, robustness
