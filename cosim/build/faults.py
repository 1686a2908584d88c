"""Diagnosis of kernels that do not compile, in the author's terms: file, line, variable, and how to fix it.

numba's messages refer to types and to its own passes. When numba rejects kernels, this module reads their source and
that of the kernels that they call, and finds common mistakes: unknown names and variables, assignment to a whole array,
lists, dicts and strings, creation of arrays, random numbers, calls of functions that are not kernels.

It also reads what compiles, but is hardly meant, such as variables that have a value on some paths only.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from cosim.build.paths import always_ends, unassigned, walk
from cosim.model import Model, record_layout

__all__ = ["doubts_of", "faults_of", "place", "refusals_of", "shared_of"]

_NEW_ARRAYS = (
    *("arange", "array", "asarray", "concatenate", "copy", "diag", "empty", "empty_like", "eye", "full", "full_like"),
    *("hstack", "linspace", "ones", "ones_like", "outer", "vstack", "zeros", "zeros_like"),
)
_ALIASES = {"np": "numpy as np", "numpy": "numpy", "math": "math"}
_REMEMBERED = "what a kernel remembers are variables of its record (State, Memory)"
_NOT_IN_KERNELS: dict[type[ast.AST], str] = {
    ast.Dict: f"a kernel has no dicts; {_REMEMBERED}",
    ast.DictComp: f"a kernel has no dicts; {_REMEMBERED}",
    ast.Set: "a kernel has no sets; write the comparisons out",
    ast.SetComp: "a kernel has no sets; write the comparisons out",
    ast.List: f"a kernel has no lists; write a tuple, (1.0, 2.0); {_REMEMBERED}",
    ast.ListComp: "a kernel has no lists; write a loop over an array of the record",
    ast.GeneratorExp: "a kernel has no generators; write a loop",
    ast.Yield: "a kernel has no generators; it returns once",
    ast.JoinedStr: "a kernel has no strings; return a key of errors, whose text the model declares",
    ast.Lambda: "a kernel has no nested functions; write a @kernel at module level",
    ast.FunctionDef: "a kernel has no nested functions; write a @kernel at module level",
    ast.ClassDef: "a kernel has no nested classes",
    ast.Try: "a kernel does not catch exceptions; test for the condition first",
    ast.With: "a kernel has no with statement",
    ast.Import: "a kernel does not import; import at module level",
    ast.ImportFrom: "a kernel does not import; import at module level",
    ast.Global: f"a kernel has no global variables; {_REMEMBERED}",
    ast.Await: "a kernel cannot await",
}
_BUILTINS_OF_KERNELS = (
    *("abs", "bool", "divmod", "enumerate", "float", "int", "len", "max", "min", "pow", "range", "round", "sum", "zip"),
)


_RANDOM = ("random.", "secrets.", "numpy.random.")
_CLOCKS = ("time", "datetime")
_RANDOM_NUMBERS = "normal_pair or threefry of cosim.random_numbers, which give the same in every run"

_NO_FLOATS = (math.ceil, math.floor, math.trunc, math.isnan, math.isinf, math.isfinite, math.gcd, math.factorial)


_TO_INT = "it is to return an int"
_NO_RESULTS = {"int": ("None", "a float", "a tuple"), "float": ("None", "a tuple"), "bool": ("None", "a tuple")}
"""Type that a kernel is to return -> what it must not return instead."""


def place(file: str, line: int) -> str:
    """Returns ``file:line``, relative to the working folder if the file is below it."""
    relative = os.path.relpath(file)
    return f"{Path(file).absolute() if relative.startswith('..') else relative}:{line}"


def faults_of(model: type[Model], returned: Callable[[Any], Iterable[str]] = lambda _: ()) -> list[str]:
    """Returns each fault of the model's kernels as ``file:line: what; how to fix it``, in source order.

    `returned`: gives what a kernel has been found to return, in words ("a float"); empty if that is unknown.
    """
    readers = list(_readers(model))
    for reader in readers:
        for kind in returned(reader.kernel):
            reader.compare_returned(kind)
    return _told(one for reader in readers for one in reader.faults)


def refusals_of(model: type[Model]) -> list[str]:
    """Returns each return of a bool where an int is meant, with file and line: True would be taken for 1."""
    return _told(one for reader in _read(model) for one in reader.refusals)  # type: ignore[arg-type]


def doubts_of(model: type[Model]) -> list[str]:
    """Returns what compiles in the model's kernels, but is hardly meant, with file and line:

    - assignments that give a float to an int or bool variable: as in NumPy, they cut the fraction off. Only values are
      reported that are certainly floats;
    - kernels that return a value on some paths, and end without one on others: their caller then fails in the step;
    - local variables that have a value on some paths only: compiled, they are 0 on the others;
    - powers of ints with a negative exponent: compiled, they are ints.
    """
    return _told(one for reader in _read(model) for one in reader.doubts)  # type: ignore[arg-type]


def shared_of(model: type[Model]) -> list[str]:
    """Returns what instances and runs of a model without kernels share in one process, with file and line.

    These are variables of its module that a function assigns, lists and dicts of its module and its class that one
    changes, and random numbers that nothing has seeded.
    """
    module = sys.modules[model.__module__]
    file = str(module.__file__)
    tree = ast.parse(Path(file).read_bytes())
    found: list[tuple[str, int, str]] = []
    given = (target for one in walk(tree) if isinstance(one, ast.Assign) for target in one.targets)
    own = {target.attr for target in given if isinstance(target, ast.Attribute)}
    for function in (one for one in walk(tree) if isinstance(one, ast.FunctionDef)):
        local = {*_assigned_names(function)}
        for changed in _changed(function):
            value, of = None, ""
            if isinstance(changed, ast.Name) and changed.id not in local:
                value, of = vars(module).get(changed.id), "module"
            elif isinstance(changed, ast.Attribute) and changed.attr not in own:
                value, of = vars(model).get(changed.attr), "class"
            if isinstance(value, dict | list | set | np.ndarray):
                what = f"{ast.unparse(changed)} is a {type(value).__name__} of the {of}"
                found.append((file, changed.lineno, f"{what}, {_SHARED}; {_OWN}"))
    seeded = False
    random: list[tuple[str, int, str]] = []
    for node in walk(tree):
        if isinstance(node, ast.Global):
            texts = (f"{name} is a variable of the module, {_SHARED}; {_OWN}" for name in node.names)
            found += [(file, node.lineno, text) for text in texts]
        if isinstance(node, ast.Call) and f"{_module_of(called := _object(node.func, module))}.".startswith(_RANDOM):
            name = ast.unparse(node.func)
            seeded = seeded or name.endswith("seed")
            makes = inspect.isclass(called) or name.endswith("default_rng")
            if not (makes and (node.args or node.keywords)):
                random.append((file, node.lineno, f"{name} differs from run to run; use {_RANDOM_NUMBERS}"))
    return _told(found if seeded else [*found, *random])


_CHANGES = (
    *("add", "append", "clear", "discard", "extend", "fill", "insert", "pop", "popitem", "remove", "reverse"),
    *("setdefault", "sort", "update"),
)
"""Methods that change a list, dict, set or array."""


def _changed(function: ast.FunctionDef) -> Iterator[ast.expr]:
    """Yields what a function changes in place: the x of x[0] = 1, x.append(1) and self.x += [1]."""
    for node in walk(function):
        match node:
            case ast.Subscript(value=value, ctx=ast.Store() | ast.Del()):
                yield value
            case ast.Call(func=ast.Attribute(value=value, attr=method)) if method in _CHANGES:
                yield value
            case ast.AugAssign(target=ast.Attribute() as value):
                yield value


def _object(node: ast.expr, module: ModuleType) -> Any:
    """Returns what a name of a module, or of one that it imports, refers to; None if unknown."""
    if isinstance(node, ast.Name):
        return vars(module).get(node.id)
    if isinstance(node, ast.Attribute) and inspect.ismodule(of := _object(node.value, module)):
        return getattr(of, node.attr, None)
    return None


def _module_of(value: Any) -> str:
    """Returns the name of the module of an object: a module, function, class, or the method of an instance."""
    of = getattr(value, "__self__", value)
    if inspect.ismodule(of):
        return of.__name__
    return str(getattr(value, "__module__", None) or type(of).__module__)


_SHARED = "which all instances and runs of a process share"
_OWN = "declare a State or Memory, or make it an attribute of self in initialize"


def _told(found: Iterable[tuple[str, int, str]]) -> list[str]:
    return [
        f"{place(file, line)}: {text}" for file, line, text in sorted(dict.fromkeys(found), key=lambda one: one[:2])
    ]


@lru_cache(maxsize=1)
def _read(model: type[Model]) -> tuple[_Reader, ...]:
    return tuple(_readers(model))


def _readers(model: type[Model]) -> Iterator[_Reader]:
    """Yields a reader of each kernel of the model, and of each that these call."""
    assert model.kernels is not None
    known: set[_Call] = set()
    record = _Record(model)
    for kernel, number in zip(model.kernels, (1, 3), strict=True):
        waiting = [(_Call(kernel, (record.argument, *[""] * (number - 1)), ""), True)]
        while waiting:
            call, entry = waiting.pop()
            if call in known:
                continue
            known.add(call)
            reader = _Reader.of(call, record, entry)
            if reader is None:
                continue
            yield reader
            waiting += [(one, False) for one in reader.calls]


class _Call(NamedTuple):
    """A call of a kernel."""

    kernel: Any
    arguments: tuple[str, ...]
    """`_Record.argument` for the record, empty for any other"""
    needs: str
    """what the caller says that it is given: a type such as int; empty if it says nothing"""


class _Record:
    """The fields of a model's record: name -> shape, and name -> NumPy's kind of its type ("f", "i", "b")."""

    argument = "record"
    """Stands for a record among the arguments of a call."""

    def __init__(self, model: type[Model]) -> None:
        self.model = model.__name__
        dtype, _ = record_layout(model.variables)
        assert dtype.fields is not None
        self.shapes: Mapping[str, tuple[int, ...]] = {name: field[0].shape for name, field in dtype.fields.items()}
        self.kinds: Mapping[str, str] = {name: field[0].base.kind for name, field in dtype.fields.items()}


class _Reader(ast.NodeVisitor):
    """Reads one function, some of whose arguments are the record."""

    def __init__(self, call: _Call, tree: ast.FunctionDef, records: set[str], record: _Record, entry: bool) -> None:
        self.kernel = call.kernel
        function = getattr(call.kernel, "py_func", call.kernel)
        self.file = function.__code__.co_filename
        self.records, self.record, self.entry = records, record, entry
        self.tree, self.needed = tree, call.needs
        self.returns = _type_name(tree.returns) or call.needs
        self.faults: list[tuple[str, int, str]] = []
        self.doubts: list[tuple[str, int, str]] = []
        self.refusals: list[tuple[str, int, str]] = []
        self.calls: list[_Call] = []
        self._needs: dict[ast.expr, str] = {}  # expression -> type that it is said to have
        code = function.__code__
        self.local = {*code.co_varnames, *code.co_cellvars}
        cells = function.__closure__ or ()
        self.outer = {**vars(builtins), **function.__globals__}
        for name, cell in zip(code.co_freevars, cells, strict=True):
            self.outer[name] = cell.cell_contents
        self._values = _assigned_names(tree)
        self._body(tree)
        for line, text in unassigned(tree, {*code.co_varnames, *code.co_cellvars}, records):
            self.doubts.append((self.file, line, text))

    @classmethod
    def of(cls, call: _Call, record: _Record, entry: bool) -> _Reader | None:
        """Returns the reader of a kernel, or None if its source is not available."""
        kernel = call.kernel
        function = getattr(kernel, "py_func", kernel)
        try:
            tree = _parsed(function)
        except (OSError, SyntaxError, TypeError):
            return None
        if not tree.body or not isinstance(tree.body[0], ast.FunctionDef):
            return None
        names = [argument.arg for argument in tree.body[0].args.args]
        records = {name for name, given in zip(names, call.arguments, strict=False) if given == record.argument}
        reader = cls(call, tree.body[0], records, record, entry)
        if function is kernel and not hasattr(kernel, "py_func") and entry:
            reader.faults.insert(0, (reader.file, tree.body[0].lineno, _not_a_kernel(kernel.__name__)))
        return reader

    def _body(self, tree: ast.FunctionDef) -> None:
        for statement in tree.body:
            self.visit(statement)
        returns = [node for node in walk(tree) if isinstance(node, ast.Return)]
        key = f"{tree.name} returns 0, or a key of errors"
        for one in returns:
            # One that says itself that it returns an int may mean 0 or 1; its caller does not.
            if one.value is not None and (self.entry or self.needed == "int") and self._is_bool(one.value):
                given = ast.unparse(one.value)
                text = f"{key}, not {given}" if self.entry else f"{tree.name} returns a bool, {given}; {_TO_INT}"
                self._fault(one, text)
                self.refusals.append(self.faults[-1])
        if any(one.value is not None for one in returns) and not always_ends(tree.body):
            text = (
                f"{tree.name} ends here without a value, which it returns elsewhere; end it with return and its value"
            )
            self.doubts.append((self.file, tree.body[-1].lineno, text))
        if not self.entry:
            return
        if not returns:
            self._fault(tree.body[-1], f"{key}: end it with return 0")
        for one in returns:
            if one.value is None:
                self._fault(one, f"{key}: write return 0")
            elif isinstance(one.value, ast.Constant) and type(one.value.value) is not int:
                self._fault(one, f"{key}, not {ast.unparse(one.value)}")

    def compare_returned(self, kind: str) -> None:
        """Notes a fault if the kernel returns `kind`, and is to return another type of number."""
        if kind not in _NO_RESULTS.get(self.returns, ()) or self.entry:
            return
        text = f"it is to return {'an int' if self.returns == 'int' else f'a {self.returns}'}"
        returns = [node for node in walk(self.tree) if isinstance(node, ast.Return)]
        if kind == "None":
            last = returns[0] if returns else self.tree.body[-1]
            self._fault(last, f"{self.tree.name} returns nothing; {text}: end it with return and its value")
            return
        of_this = [one for one in returns if one.value is not None and self._is_float(one.value)] or returns
        for one in of_this if kind == "a float" else returns:
            self._fault(one, f"{self.tree.name} returns {kind}; {text}")

    def _fault(self, node: ast.AST, text: str) -> None:
        self.faults.append((self.file, getattr(node, "lineno", 0), text))

    # ---- evaluation of expressions ----------------------------------------------------------------------------------

    def _shape(self, node: ast.AST) -> tuple[int, ...] | None:
        """Returns the shape of ``m.field``; None for any other expression."""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in self.records:
            return self.record.shapes.get(node.attr)
        return None

    def _kind(self, node: ast.AST) -> str:
        """Returns NumPy's kind of ``m.field`` or ``m.field[i]``; empty for any other expression."""
        of = node.value if isinstance(node, ast.Subscript) else node
        return (
            self.record.kinds.get(of.attr, "") if isinstance(of, ast.Attribute) and self._shape(of) is not None else ""
        )

    def _is_float(self, node: ast.AST) -> bool:
        """Returns whether an expression is certainly a float."""
        match node:
            case ast.Constant(value=value):
                return isinstance(value, float)
            case ast.BinOp(left=left, op=op, right=right):
                return isinstance(op, ast.Div) or self._is_float(left) or self._is_float(right)
            case ast.UnaryOp(op=op, operand=operand):
                return not isinstance(op, ast.Not) and self._is_float(operand)
            case ast.IfExp(body=body, orelse=orelse):
                return self._is_float(body) or self._is_float(orelse)
            case ast.Call(func=function, args=arguments):
                called = self._value(function)
                if called in (max, min, abs):
                    return any(map(self._is_float, arguments))
                return called is float or (getattr(called, "__module__", "") == "math" and called not in _NO_FLOATS)
            case _:
                return self._kind(node) == "f"

    def _is_bool(self, node: ast.AST, through: tuple[str, ...] = ()) -> bool:
        """Returns whether an expression is certainly a bool. `through`: variables whose values are looked at."""
        match node:
            case ast.Constant(value=value):
                return isinstance(value, bool)
            case ast.Compare() | ast.UnaryOp(op=ast.Not()):
                return True
            case ast.BoolOp(values=values):
                return all(self._is_bool(one, through) for one in values)
            case ast.IfExp(body=body, orelse=orelse):
                return self._is_bool(body, through) and self._is_bool(orelse, through)
            case ast.Call(func=function):
                return self._value(function) is bool
            case ast.Name(id=name):
                given = [] if name in through else self._values.get(name, [])
                return bool(given) and all(one is not None and self._is_bool(one, (*through, name)) for one in given)
            case _:
                return self._kind(node) == "b"

    def _library(self, node: ast.expr) -> str:
        """Returns the module that a called function is of, also as a method of a global object; empty if unknown."""
        while (value := self._value(node)) is None or hasattr(value, "py_func"):
            if not isinstance(node, ast.Attribute):
                return ""
            node = node.value
        return _module_of(value)

    def _value(self, node: ast.AST) -> Any:
        """Returns the object that a global name or a module attribute refers to; None if unknown."""
        if isinstance(node, ast.Name) and node.id not in self.local:
            return self.outer.get(node.id)
        if isinstance(node, ast.Attribute) and inspect.ismodule(module := self._value(node.value)):
            return getattr(module, node.attr, None)
        return None

    # ---- nodes ------------------------------------------------------------------------------------------------------

    def generic_visit(self, node: ast.AST) -> None:
        if (text := _NOT_IN_KERNELS.get(type(node))) is not None:
            self._fault(node, text)
            return
        super().generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        """Accepts string arguments: exceptions need texts."""

    def visit_Assert(self, node: ast.Assert) -> None:
        self.visit(node.test)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str | bytes):
            self._fault(node, "a kernel has no strings; use an IntEnum, or return a key of errors")

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load) and node.id not in self.local and node.id not in self.outer:
            names = [*self.local, *(name for name in self.outer if not name.startswith("__"))]
            self._fault(node, f'no name "{node.id}"{_meant(node.id, names)}')
        if type(of := self._value(node)) in (dict, list, set):
            kind = type(of).__name__
            self._fault(node, f"{node.id} is a {kind} of the module; a kernel has no {kind}s; {_REMEMBERED}")

    def visit_Attribute(self, node: ast.Attribute) -> None:
        of = node.value
        if isinstance(of, ast.Name) and of.id in self.records:
            if node.attr not in self.record.shapes:
                meant = _meant(node.attr, list(self.record.shapes))
                self._fault(node, f'no variable "{node.attr}" in {self.record.model}{meant}')
            return
        if inspect.ismodule(module := self._value(of)) and not hasattr(module, node.attr):
            self._fault(node, f'{ast.unparse(of)} has no "{node.attr}"{_meant(node.attr, dir(module))}')
        self.visit(of)

    def visit_Assign(self, node: ast.Assign) -> None:
        for target in node.targets:
            self._assigned(target, node.value)
            if isinstance(target, ast.Name) and isinstance(node.value, ast.Name) and node.value.id in self.records:
                self.records.add(target.id)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._given(node.target, ast.BinOp(node.target, node.op, node.value))
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if isinstance(node.op, ast.Pow) and self._kind(node.left) in ("i", "u") and _is_negative_int(node.right):
            left, right = ast.unparse(node.left), ast.unparse(node.right)
            text = f"{left} is an int, so {left} ** {right} is one, too, mostly 0; write float({left}) ** {right}"
            self.doubts.append((self.file, node.lineno, text))
        sides = (side.value if isinstance(side, ast.Subscript) and _has_slice(side) else side for side in _sides(node))
        if any(self._shape(side) for side in sides):
            self._fault(node, f"{ast.unparse(node)} creates an array, which a kernel cannot: write a loop")
            return
        self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self.visit(node.target)
        if node.value is not None:
            self._assigned(node.target, node.value)
            self._needs[node.value] = _type_name(node.annotation)
            self.visit(node.value)

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is not None:
            self._needs[node.value] = self.returns
            self.visit(node.value)

    def _assigned(self, target: ast.expr, value: ast.expr) -> None:
        left, right = ast.unparse(target), ast.unparse(value)
        to, given = self._shape(target), self._shape(value)
        self._given(target, value)
        if to and given and to != given:
            self._fault(target, f"{left} is an array of {_sizes(to)}, {right} one of {_sizes(given)}")
        elif to:
            what = "copies an array" if given else f"assigns to an array of {_sizes(to)}"
            self._fault(target, f"{left} = {right} {what}: write {left}[:] = {right}")
        elif to == () and given:
            self._fault(target, f"{left} is a scalar, {right} is an array of {_sizes(given)}: give it an element of it")
        elif to == () and isinstance(value, ast.Tuple):
            self._fault(
                target, f"{left} is a scalar: it cannot be given a tuple; declare it with shape={len(value.elts)}"
            )

    def _given(self, target: ast.expr, value: ast.expr) -> None:
        """Notes a variable that would need to be a float for this value."""
        kind, name = self._kind(target), ast.unparse(target)
        if kind in ("i", "u", "b") and self._is_float(value):
            what, fix = ("a bool", "a comparison") if kind == "b" else ("an int", "int(...) or round(...)")
            text = (
                f"{name} is {what}, so the fraction of {ast.unparse(value)} is cut off; declare a float, or write {fix}"
            )
            self.doubts.append((self.file, target.lineno, text))

    def visit_Subscript(self, node: ast.Subscript) -> None:
        shape = self._shape(node.value)
        name = ast.unparse(node.value)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if shape == ():
            self._fault(node, f"{name} is a scalar and has no elements; declare it with shape=")
        elif shape is not None and len(indices) > len(shape):
            self._fault(node, f"{name} has {len(shape)} dimension{'s' * (len(shape) > 1)}, not {len(indices)}")
        if isinstance(node.ctx, ast.Store) and isinstance(self._value(node.value), np.ndarray):
            self._fault(node, f"{name} is an array of the module, which is constant in a kernel; {_REMEMBERED}")
        for index in indices:
            if shape is not None and isinstance(index, ast.Constant) and not isinstance(index.value, int):
                self._fault(node, f"index {ast.unparse(index)} of {name}: an index is an int")
                return
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        called, name = self._value(node.func), ast.unparse(node.func)
        library = self._library(node.func)
        if f"{library}.".startswith(_RANDOM):
            self._fault(node, f"{name}: a kernel has no random numbers of its own; use {_RANDOM_NUMBERS}")
            return
        if library in _CLOCKS:
            self._fault(node, f"{name}: a kernel has no clock; the time of the run [s] is the argument t")
            return
        if hasattr(called, "py_func"):
            self._call(node, called, name)
        elif isinstance(called, FunctionType) and called.__module__.partition(".")[0] not in ("numpy", "numba", "math"):
            self._fault(node, _not_a_kernel(name))
        elif inspect.isbuiltin(called) or inspect.isclass(called):
            own = getattr(builtins, called.__name__, None) is called
            if own and called.__name__ not in _BUILTINS_OF_KERNELS:
                self._fault(node, f"a kernel has no {called.__name__}()")
                return
        if getattr(called, "__name__", "") in _NEW_ARRAYS and name.partition(".")[0] in ("np", "numpy"):
            self._fault(node, f"{name} creates an array, which a kernel cannot: declare a Memory")
            return
        self.generic_visit(node)

    def _call(self, node: ast.Call, called: Any, name: str) -> None:
        parameters = inspect.signature(called.py_func)
        known = [*takewhile(lambda argument: not isinstance(argument, ast.Starred), node.args)]
        whole = len(known) == len(node.args) and all(keyword.arg for keyword in node.keywords)
        try:
            # The source does not say how many arguments *tuple gives.
            bind = parameters.bind if whole else parameters.bind_partial
            bound = bind(*known, **{k.arg: k.value for k in node.keywords if k.arg})
        except TypeError as error:
            self._fault(node, f"{name}{parameters.replace(return_annotation=inspect.Signature.empty)}: {error}")
            return
        given = tuple(
            self.record.argument if isinstance(a, ast.Name) and a.id in self.records else ""
            for a in (bound.arguments.get(parameter) for parameter in parameters.parameters)
        )
        self.calls.append(_Call(called, given, self._needs.get(node, "")))


_DEFINED = re.compile(r"([ \t]*)(?:async[ \t]+)?def\b")


def _parsed(function: Any) -> ast.Module:
    """Returns the definition of a function, with the lines of its file.

    Raises:
        OSError, SyntaxError, TypeError: its source is not available.
    """
    lines, first = inspect.findsource(function)
    head = next((n for n in range(first, len(lines)) if _DEFINED.match(lines[n])), first)
    indent = len(lines[head]) - len(lines[head].lstrip())
    end = next((n for n in range(head + 1, len(lines)) if _is_beyond(lines[n], indent)), len(lines))
    try:
        return _placed(lines[first:end], first)
    except SyntaxError:  # a line within a string or parentheses is not indented: by tokens, in twice the time
        return _placed(inspect.getblock(lines[first:]), first)


def _is_beyond(line: str, indent: int) -> bool:
    """Returns whether a line is not part of a definition that is indented so far."""
    text = line.lstrip()
    return len(line) - len(text) <= indent and not (not text or text.startswith(("#", ")")))


def _placed(lines: Sequence[str], above: int) -> ast.Module:
    tree = ast.parse(textwrap.dedent("".join(lines)))
    for one in walk(tree):
        if "lineno" in one._attributes:
            one.lineno += above  # type: ignore[attr-defined]
    return tree


def _assigned_names(tree: ast.AST) -> dict[str, list[ast.expr | None]]:
    """Returns the local variables of a function -> the values that they are assigned; None: one that is not shown."""
    found: dict[str, list[ast.expr | None]] = {}
    shown: set[ast.Name] = set()
    nodes = walk(tree)
    for node in nodes:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        for target in targets:
            if isinstance(target, ast.Name) and node.value is not None:  # type: ignore[attr-defined]
                found.setdefault(target.id, []).append(node.value)  # type: ignore[attr-defined]
                shown.add(target)
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node not in shown:
            found.setdefault(node.id, []).append(None)
        elif isinstance(node, ast.arg):
            found.setdefault(node.arg, []).append(None)
    return found


def _is_negative_int(node: ast.AST) -> bool:
    match node:
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=value)):
            return type(value) is int and value > 0
        case _:
            return False


def _type_name(annotation: ast.expr | None) -> str:
    return annotation.id if isinstance(annotation, ast.Name) else ""


def _sides(node: ast.BinOp) -> tuple[ast.expr, ast.expr]:
    return node.left, node.right


def _has_slice(node: ast.Subscript) -> bool:
    return any(isinstance(part, ast.Slice) for part in walk(node.slice))


def _not_a_kernel(name: str) -> str:
    return f"{name} is not a kernel: write @kernel above its def"


def _sizes(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _meant(name: str, candidates: Sequence[str]) -> str:
    if name in _ALIASES:
        return f"; write import {_ALIASES[name]} at the top of the module"
    names = sorted(set(candidates))
    close = get_close_matches(name, names, 1, 0.5) or (names if len(names) == 1 else [])
    if close:
        return f'; did you mean "{close[0]}"?'
    return f"; there are {', '.join(names)}" if 0 < len(names) < 20 else ""
