"""Reads and checks a user's own effect of the radio: a Python file with a function `channel` (`cosim.channel`).

The function runs in the process of the run, compiled into its loop. Therefore the file is limited to arithmetic, which
can neither access files or memory nor run for ever: functions that call only functions above them, numbers, `if`,
`for ... in range(...)` with at most a thousand turns, `math`, and the names of `cosim.channel`. The file is parsed
here, and nothing of it is executed.
"""

from __future__ import annotations

import ast
import hashlib
import math
import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.diagnostics.names import near

__all__ = ["FUNCTION", "OwnChannel", "read_own_channel"]

FUNCTION = "channel"
FIELDS = {
    **dict.fromkeys(("time", "delay", "distance", "length", "message", "system", "number"), 0),
    **dict.fromkeys(("sender", "receiver"), 3),
}
"""Fields of a packet, and the number of their elements; 0: a single number."""
GIVEN = ("LOST", "Packet", "chance", "normal")
"""Names that a file may import from `cosim.channel`."""
_POSITIONS = {"distance", "sender", "receiver"}
_MATH = {
    *("acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cos", "cosh", "sin", "sinh", "tan", "tanh", "hypot"),
    *("exp", "expm1", "log", "log10", "log1p", "log2", "pow", "sqrt", "erf", "erfc", "gamma", "lgamma"),
    *("ceil", "copysign", "degrees", "fabs", "floor", "isfinite", "isinf", "isnan", "radians", "trunc"),
}
_NUMBERS = ("e", "inf", "nan", "pi", "tau")
"""Functions and numbers of `math`."""
_BUILT_IN = ("abs", "bool", "float", "int", "max", "min")
_PLAIN = (ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp)
_TURNS = 1000
_OPERATIONS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Pow: operator.pow,
}
_NOT_ARITHMETIC = (ast.MatMult, ast.In, ast.NotIn, ast.Is, ast.IsNot)


@dataclass(frozen=True, slots=True)
class OwnChannel:
    """A checked file with an effect of the radio.

    Attributes:
        file: its path as written.
        path: the file itself.
        sha256: the digest of its contents.
        places: whether it uses positions of nodes.
        constants: names and values of its constants.
        code: its contents.
    """

    file: str
    path: Path
    sha256: str
    places: bool
    constants: tuple[tuple[str, float], ...] = field(repr=False)
    code: str = field(repr=False)


def read_own_channel(path: Path, written: str, problems: list[Problem]) -> OwnChannel | None:
    """Reads the file of an own effect; adds its problems, with their lines, to `problems`.

    Args:
        written: the path as written in the system.

    Raises:
        OSError: the file cannot be read.
    """
    data = path.read_bytes()
    check = _Check()
    try:
        code = data.decode("utf-8-sig")
        found = [Problem(Where(str(path), line), text) for line, text in check.module(ast.parse(code))]
    except (SyntaxError, ValueError) as error:
        line = error.lineno if isinstance(error, SyntaxError) else None
        text = error.msg if isinstance(error, SyntaxError) else str(error)
        problems.append(Problem(Where(str(path), line), f"is not Python: {text}"))
        return None
    except (RecursionError, MemoryError):
        found = [Problem(Where(str(path)), "is nested too deeply")]
    problems += found
    if found:
        return None
    return OwnChannel(written, path, hashlib.sha256(data).hexdigest(), check.places, (*check.constants.items(),), code)


class _Check:
    """Yields the lines and texts of problems of a module.

    Attributes:
        places: whether positions of nodes are used.
        constants: values by name.
    """

    def __init__(self) -> None:
        self.places = False
        self.constants: dict[str, float] = {}
        self._functions: dict[str, int] = {}
        self._imported: set[str] = set()

    def module(self, tree: ast.Module) -> Iterator[tuple[int, str]]:
        for node in tree.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                yield from self._import(node)
            elif isinstance(node, ast.FunctionDef):
                yield from self._function(node)
                self._functions[node.name] = len(node.args.args)
            elif isinstance(node, ast.Assign | ast.AnnAssign) and (name := _name(node)) is not None:
                yield from self._constant(name, node)
            elif not _is_text(node):
                yield node.lineno, f"{_words(node)} is not possible here; valid: imports, NAME = number, functions"
        if self._functions.get(FUNCTION) != 1:
            text = "is missing" if FUNCTION not in self._functions else "has one parameter, the packet"
            yield 1, f"the function {FUNCTION}(packet) {text}; `uav-cosim new channel FILE` writes an example"

    def _import(self, node: ast.Import | ast.ImportFrom) -> Iterator[tuple[int, str]]:
        module = node.module if isinstance(node, ast.ImportFrom) else None
        if any(one.asname for one in node.names):
            yield node.lineno, "an import with `as` is not possible; use the name itself"
        elif module == "cosim.channel":
            for name in sorted({one.name for one in node.names} - {*GIVEN}):
                yield node.lineno, f'cosim.channel has no name "{name}" for channels; {near(name, GIVEN)}'
            self._imported |= {one.name for one in node.names}
        elif module is None and [one.name for one in node.names] == ["math"]:
            self._imported.add("math")
        elif module != "__future__":
            text = "valid are `import math` and `from cosim.channel import ...`"
            yield node.lineno, f"{module or ', '.join(one.name for one in node.names)} cannot be imported; {text}"

    def _constant(self, name: str, node: ast.Assign | ast.AnnAssign) -> Iterator[tuple[int, str]]:
        try:
            self.constants[name] = 0.0  # also of a wrong one, which is reported once
            if node.value is not None:
                self.constants[name] = _value(node.value, self.constants)
        except (ArithmeticError, ValueError, TypeError) as error:
            yield node.lineno, f"{name} is not a number: {error}"
        if name in {*self._functions, *GIVEN, *_BUILT_IN, "math", "range"}:
            yield node.lineno, f'the name "{name}" already has another meaning; rename the constant'

    def _function(self, node: ast.FunctionDef) -> Iterator[tuple[int, str]]:
        args = node.args
        if args.posonlyargs or args.kwonlyargs or args.vararg or args.kwarg or args.defaults:
            yield node.lineno, f"the parameters of {node.name} are plain names, without defaults"
        if node.decorator_list:
            yield node.lineno, f"{node.name} has a decorator; remove it, the function is compiled without one"
        if node.name in {*self._functions, *self.constants, *GIVEN, *_BUILT_IN, "math", "range"}:
            yield node.lineno, f'the name "{node.name}" already has another meaning; rename the function'
        parameters = tuple(one.arg for one in args.args)
        local = {one.id for one in ast.walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)}
        taken = {*self._functions, *self.constants, *GIVEN, *_BUILT_IN, "math", "range"}
        for name in sorted((local | {*parameters}) & taken):
            yield node.lineno, f'{node.name} assigns to "{name}", which already has another meaning; rename it'
        body = node.body[1:] if _is_text(node.body[0]) else node.body
        yield from self._statements(body, {*parameters, *self.constants}, parameters)
        if not _ends(body):
            yield node.lineno, f"{node.name} can end without a result; end it with `return VALUE`"
        if node.name == FUNCTION:
            results = [
                one for inner in ast.walk(node) if isinstance(inner, ast.Return) for one in _results(inner.value)
            ]
            bools = [one for one in results if _is_bool(one)]
            for one in bools if len(bools) < len(results) else ():  # that all are bools is told when it is compiled
                text = (
                    f"`{ast.unparse(one)[:40]}` is no delay: return LOST to lose a packet, packet.delay to let it pass"
                )
                yield one.lineno, text

    def _statements(
        self, body: list[ast.stmt], known: set[str], parameters: tuple[str, ...]
    ) -> Iterator[tuple[int, str]]:
        """Yields the problems of statements; adds the names that have a value after them to `known`."""
        for node in body:
            if isinstance(node, ast.For):
                yield from self._loop(node, known, parameters)
            elif isinstance(node, ast.If):
                yield from self._expression(node.test, known, parameters)
                then, otherwise = {*known}, {*known}
                yield from self._statements(node.body, then, parameters)
                yield from self._statements(node.orelse, otherwise, parameters)
                known |= otherwise if _ends(node.body) else then if _ends(node.orelse) else then & otherwise
            elif isinstance(node, ast.Return) and node.value is not None:
                yield from self._expression(node.value, known, parameters)
            elif isinstance(node, ast.Assign | ast.AugAssign | ast.AnnAssign):
                yield from self._assignment(node, known, parameters)
            elif not isinstance(node, ast.Pass | ast.Break | ast.Continue) and not _is_text(node):
                yield node.lineno, f"{_words(node)} is not possible; a channel is limited to arithmetic"

    def _loop(self, node: ast.For, known: set[str], parameters: tuple[str, ...]) -> Iterator[tuple[int, str]]:
        try:
            if not isinstance(node.target, ast.Name) or not _is_range(node.iter) or node.orelse:
                raise ValueError("a loop has the form `for NAME in range(...)`")
            assert isinstance(node.iter, ast.Call)
            bounds = [_value(one, self.constants) for one in node.iter.args]
            if not all(isinstance(one, int) for one in bounds) or len(range(*map(int, bounds))) > _TURNS:
                raise ValueError(f"a loop has at most {_TURNS} turns, by whole numbers")
        except (ArithmeticError, ValueError, TypeError) as error:
            yield node.lineno, f"`range`: {error}" if _is_range(node.iter) else str(error)
            return
        yield from self._statements(node.body, {*known, node.target.id}, parameters)

    def _assignment(
        self, node: ast.Assign | ast.AugAssign | ast.AnnAssign, known: set[str], parameters: tuple[str, ...]
    ) -> Iterator[tuple[int, str]]:
        name = _name(node)
        if name is None or node.value is None:
            yield node.lineno, "values are assigned to single names only"
            return
        if isinstance(node, ast.AugAssign):
            yield from self._expression(ast.copy_location(ast.Name(name, ast.Load()), node), known, parameters)
        yield from self._expression(node.value, known, parameters)
        known.add(name)

    def _expression(self, node: ast.expr, known: set[str], parameters: tuple[str, ...]) -> Iterator[tuple[int, str]]:
        """Yields the problems of an expression; `parameters` are those of its function."""
        if isinstance(node, ast.Constant):
            if not isinstance(node.value, bool | int | float) or abs(node.value) > 2**62:
                yield node.lineno, f"{ast.unparse(node)[:40]} is not a number up to 2^62"
        elif isinstance(node, ast.Name):
            if node.id not in known | self._imported - {"math", "Packet", "chance", "normal"}:
                yield node.lineno, f'there is no value "{node.id}"; {near(node.id, known | self._imported)}'
        elif isinstance(node, ast.Call):
            yield from self._call(node, known, parameters)
        elif isinstance(node, ast.Attribute | ast.Subscript):
            yield from self._field(node, parameters)
        elif not isinstance(node, _PLAIN) or isinstance(getattr(node, "op", None), _NOT_ARITHMETIC):
            yield node.lineno, f"`{ast.unparse(node)[:40]}` is not arithmetic"
        else:
            if isinstance(node, ast.Compare) and any(isinstance(one, _NOT_ARITHMETIC) for one in node.ops):
                yield node.lineno, f"`{ast.unparse(node)[:40]}` is not arithmetic"
            for inner in ast.iter_child_nodes(node):
                if isinstance(inner, ast.expr):
                    yield from self._expression(inner, known, parameters)

    def _call(self, node: ast.Call, known: set[str], parameters: tuple[str, ...]) -> Iterator[tuple[int, str]]:
        called = ast.unparse(node.func)
        drawn = called in ("chance", "normal") and called in self._imported
        if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
            yield node.lineno, f"{called} takes its arguments in their order, without names"
        elif called in self._functions or drawn:
            wanted = 2 if drawn else self._functions[called]
            if len(node.args) != wanted:
                yield node.lineno, f"{called} takes {wanted} arguments, not {len(node.args)}"
            elif drawn and not self._is_whole(node.args[1]):
                text = f"the second argument of {called} is the number of a random number, a whole one"
                yield node.lineno, f"{text}; {ast.unparse(node.args[1])[:40]} is not"
        elif called.startswith("math.") and "math" in self._imported:
            if called.removeprefix("math.") not in _MATH:
                yield node.lineno, f"{called} is not possible; {near(called, {f'math.{one}' for one in _MATH})}"
        elif called not in _BUILT_IN:
            valid = {*self._functions, *(self._imported & {"chance", "normal"}), *_BUILT_IN}
            hint = "import math first" if called.startswith("math.") else near(called, valid)
            text = "a function calls those above it only" if called in known or called == FUNCTION else hint
            yield node.lineno, f'"{called[:40]}" cannot be called; {text}'
        for i, part in enumerate(node.args):
            if not (i == 0 and isinstance(part, ast.Name) and part.id in parameters):
                yield from self._expression(part, known, parameters)

    def _is_whole(self, node: ast.expr) -> bool:
        """Returns whether a number is whole as far as its constants tell."""
        return not any(
            isinstance(one, ast.Div)
            or (isinstance(one, ast.Constant) and not isinstance(one.value, int))
            or (isinstance(one, ast.Name) and isinstance(self.constants.get(one.id), float))
            for one in ast.walk(node)
        )

    def _field(self, node: ast.Attribute | ast.Subscript, parameters: tuple[str, ...]) -> Iterator[tuple[int, str]]:
        whole = node.value if isinstance(node, ast.Subscript) else node
        if ast.unparse(node) in {f"math.{one}" for one in _NUMBERS} and "math" in self._imported:
            return
        if not (
            isinstance(whole, ast.Attribute) and isinstance(whole.value, ast.Name) and whole.value.id in parameters
        ):
            yield node.lineno, f"`{ast.unparse(node)[:40]}` is not arithmetic"
            return
        if whole.attr not in FIELDS:
            yield node.lineno, f'a packet has no field "{whole.attr}"; {near(whole.attr, FIELDS)}'
            return
        self.places = self.places or whole.attr in _POSITIONS
        index = node.slice.value if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) else None
        if FIELDS[whole.attr] and (isinstance(index, bool) or index not in range(FIELDS[whole.attr])):
            yield node.lineno, f"{whole.attr} is read by its elements: {whole.attr}[0] north, [1] east, [2] down"
        elif not FIELDS[whole.attr] and isinstance(node, ast.Subscript):
            yield node.lineno, f"{whole.attr} is a single number"


def _value(node: ast.expr, constants: Mapping[str, float]) -> float:
    """Returns the value of a constant expression.

    Raises:
        ArithmeticError, ValueError, TypeError: it has none.
    """
    value: object = None
    if isinstance(node, ast.Constant):
        value = node.value
    elif isinstance(node, ast.Name):
        value = constants.get(node.id)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = -_value(node.operand, constants)
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        left, right = _value(node.left, constants), _value(node.right, constants)
        if isinstance(node.op, ast.Pow) and abs(right) > 64:
            raise ValueError("an exponent is at most 64")
        value = _OPERATIONS[type(node.op)](left, right)
    elif isinstance(node, ast.Attribute) and ast.unparse(node) in {f"math.{one}" for one in _NUMBERS}:
        value = getattr(math, node.attr)
    elif isinstance(node, ast.Call) and ast.unparse(node.func) in {f"math.{one}" for one in _MATH}:
        value = getattr(math, ast.unparse(node.func)[5:])(*(_value(one, constants) for one in node.args))
    if not isinstance(value, int | float) or (isinstance(value, int) and abs(value) > 2**62):
        text = "it consists of numbers up to 2^62, earlier constants, + - * / // ** and `math`"
        raise ValueError(f"`{ast.unparse(node)[:40]}` has no value here; {text}")
    return value


def _name(node: ast.stmt) -> str | None:
    """Returns the only name that a statement assigns to."""
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return targets[0].id if len(targets) == 1 and isinstance(targets[0], ast.Name) else None


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _is_range(node: ast.expr) -> bool:
    named = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"
    return isinstance(node, ast.Call) and named and not node.keywords and 1 <= len(node.args) <= 3


def _ends(body: list[ast.stmt]) -> bool:
    """Returns whether statements end with a result in any case."""
    last = body[-1] if body else None
    if isinstance(last, ast.If):
        return _ends(last.body) and _ends(last.orelse)
    return isinstance(last, ast.Return)


def _results(node: ast.expr | None) -> list[ast.expr]:
    """Returns the values that an expression may have."""
    if isinstance(node, ast.IfExp):
        return [*_results(node.body), *_results(node.orelse)]
    return [] if node is None else [node]


def _is_bool(node: ast.expr) -> bool:
    """Returns whether an expression is True, False or a comparison, which would be a delay of 1 or 0 s."""
    if isinstance(node, ast.BoolOp):
        return all(map(_is_bool, node.values))
    is_not = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    return is_not or isinstance(node, ast.Compare) or (isinstance(node, ast.Constant) and isinstance(node.value, bool))


def _words(node: ast.stmt) -> str:
    return f"`{ast.unparse(node).splitlines()[0][:40]}`"
