"""Paths through the functions of kernels: whether they end with a statement, and which variables they have assigned."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from itertools import pairwise

__all__ = ["always_ends", "unassigned", "walk"]


_NO_PARTS = {"arg", "attr", "conversion", "ctx", "id", "kind", "level", "module", "op", "ops", "type_comment"}
_parts: dict[type[ast.AST], tuple[str, ...]] = {}
"""The fields of a kind of node in which there may be others."""


def walk(node: ast.AST) -> list[ast.AST]:
    """Returns a node and all within, except operators, in the order of `ast.walk`, in a third of its time."""
    found = [node]
    for one in found:
        kind = type(one)
        if (parts := _parts.get(kind)) is None:
            parts = _parts[kind] = tuple(name for name in kind._fields if name not in _NO_PARTS)
        for name in parts:
            value = getattr(one, name, None)
            if isinstance(value, list):
                found += [part for part in value if isinstance(part, ast.AST)]
            elif isinstance(value, ast.AST):
                found.append(value)
    return found


def unassigned(tree: ast.FunctionDef, local: set[str], records: set[str]) -> list[tuple[int, str]]:
    """Returns line and text for each local variable that some path reads before it has assigned it.

    Args:
        local: names of the local variables.
        records: those of them that are records, whose fields are variables of the model.
    """
    return _Paths(tree, local, records).found


class _Paths:
    """Finds local variables that some path through a function reads before it has assigned them.

    Loops are taken to run once at least, and a condition that shares a variable with those under which the value is
    assigned (`if found:`) to hold only where it is: what is found is hardly ever meant.
    """

    def __init__(self, tree: ast.FunctionDef, local: set[str], records: set[str]) -> None:
        self._tree, self._local, self._records = tree, local, records
        self.found: list[tuple[int, str]] = []
        self._known: set[str] = set()
        self._guards: list[set[str]] = []
        self._loops: list[tuple[list[frozenset[str]], list[frozenset[str]]]] = []  # at each break, at each continue
        self._blocks = [*_blocks(tree)]
        self._block(tree.body, frozenset(argument.arg for argument in walk(tree) if isinstance(argument, ast.arg)))

    def _block(self, body: Sequence[ast.stmt], have: frozenset[str] | None) -> frozenset[str] | None:
        """Returns the variables that are assigned at the end of statements, None if that is never reached."""
        guards = len(self._guards)
        for statement in body:
            if have is None:
                break
            have = self._statement(statement, have)
            leaves = isinstance(statement, ast.If) and (_leaves(statement.body) or _leaves(statement.orelse))
            if isinstance(statement, ast.While) or leaves:
                self._guards.append(self._named(statement.test))  # type: ignore[attr-defined]
        del self._guards[guards:]
        return have

    def _guarded(self, test: ast.expr, body: Sequence[ast.stmt], have: frozenset[str]) -> frozenset[str] | None:
        self._guards.append(self._named(test))
        after = self._block(body, have)
        self._guards.pop()
        return after

    def _statement(self, node: ast.stmt, have: frozenset[str]) -> frozenset[str] | None:
        match node:
            case ast.If(test=test, body=body, orelse=orelse):
                have = self._read(test, have)
                return _both(self._guarded(test, body, have), self._guarded(test, orelse, have))
            case ast.For(target=target, iter=values):
                return self._loop(node, self._read(values, have) | _stored(target))
            case ast.While(test=test):
                return self._loop(node, self._read(test, have))
            case ast.Match(subject=subject, cases=cases):
                have = self._read(subject, have)
                after = None
                for case in cases:
                    within = have | {one for part in walk(case.pattern) if (one := getattr(part, "name", None))}
                    after = _both(after, self._guarded(case.guard or subject, case.body, within))
                default = isinstance(cases[-1].pattern, ast.MatchAs) and cases[-1].pattern.pattern is None
                return after if default and cases[-1].guard is None else _both(after, have)
            case ast.Break() | ast.Continue():
                if self._loops:
                    self._loops[-1][isinstance(node, ast.Continue)].append(have)
                return None
            case ast.Return() | ast.Raise():
                self._read(node, have)
                return None
            case ast.AugAssign(target=ast.Name() as target):
                self._read_name(target, have)
            case ast.FunctionDef() | ast.ClassDef() | ast.With() | ast.Try():
                return frozenset(self._local)  # no kernel has one of these
        return self._read(node, have) | _stored(node)

    def _loop(self, node: ast.For | ast.While, have: frozenset[str]) -> frozenset[str] | None:
        self._loops.append(([], []))
        test = node.test if isinstance(node, ast.While) else node.iter
        ends = self._guarded(test, node.body, have)
        breaks, continues = self._loops.pop()
        for one in continues:
            ends = _both(ends, one)
        endless = isinstance(test, ast.Constant) and bool(test.value)
        ends = None if endless else have if ends is None and not breaks else ends
        after = self._block(node.orelse, ends)
        for one in breaks:
            after = _both(after, one)
        return after

    def _read(self, node: ast.AST, have: frozenset[str]) -> frozenset[str]:
        """Notes what an expression or simple statement reads; returns `have` and what it assigns within."""
        match node:
            case ast.Name(ctx=ast.Load()):
                self._read_name(node, have)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                have = self._read(test, have)
                self._guards.append(self._named(test))
                have = self._read(body, have) & self._read(orelse, have)
                self._guards.pop()
            case ast.BoolOp(values=values):
                always = self._read(values[0], have)
                within, guards = always, len(self._guards)
                for before, value in pairwise(values):
                    self._guards.append(self._named(before))
                    within = self._read(value, within)
                del self._guards[guards:]
                have = always
            case ast.NamedExpr(target=target, value=value):
                have = self._read(value, have) | {target.id}
            case ast.Lambda() | ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                pass  # no kernel has one of these
            case _:
                for child in ast.iter_child_nodes(node):
                    have = self._read(child, have)
        return have

    def _read_name(self, node: ast.Name, have: frozenset[str]) -> None:
        name = node.id
        if name in have or name not in self._local or name in self._known:
            return
        of_this = [(above, body) for above, body in self._blocks if any(name in _stored(one) for one in body)]
        together = {one for above, _ in of_this for part in above for one in self._named(part)}
        together |= {one for _, body in of_this for part in body for one in self._given(part)} - {name}
        if any(together & guard for guard in self._guards):
            return
        self._known.add(name)
        place = self._before(self._tree.body, node) or "it is read"
        self.found.append((node.lineno, f"{name} may have no value here: assign it before {place}"))

    def _before(self, body: Sequence[ast.stmt], use: ast.Name) -> str:
        """Returns the outermost statement that assigns a variable and does not contain its use, in words."""
        for one in body:
            if not isinstance(one, _COMPOUND) or use.id not in _stored(one) or one.lineno >= use.lineno:
                continue
            if use not in walk(one):
                return f"the {type(one).__name__.lower()} in line {one.lineno}"
            branches = [one, *one.cases] if isinstance(one, ast.Match) else [one]
            within = (inner for of in branches for part in ("body", "orelse") for inner in getattr(of, part, ()))
            if text := self._before([*within], use):
                return text
        return ""

    def _given(self, node: ast.AST) -> set[str]:
        """Returns the local variables and the fields of records that are assigned within a node."""
        targets = (target for one in walk(node) for target in getattr(one, "targets", [getattr(one, "target", None)]))
        return {name for target in targets if target is not None for name in self._named(target)}

    def _named(self, node: ast.AST) -> set[str]:
        """Returns the local variables and the fields of records that are named within a node."""
        found = {one.id for one in walk(node) if isinstance(one, ast.Name)} & (self._local - self._records)
        fields = (one for one in walk(node) if isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name))
        return found | {f"m.{one.attr}" for one in fields if one.value.id in self._records}  # type: ignore[attr-defined]


_COMPOUND = (ast.If, ast.For, ast.While, ast.Match)


def _blocks(node: ast.AST) -> Iterator[tuple[list[ast.expr], list[ast.stmt]]]:
    """Yields the statements of each branch and loop, with the expressions that they depend on."""
    for inner in walk(node):
        if isinstance(inner, ast.If | ast.For | ast.While | ast.match_case):
            # What a while depends on says something of its end only if the loop assigns it.
            parts = ("target", "guard") if isinstance(inner, ast.While) else ("test", "target", "guard")
            above = [one for one in (getattr(inner, what, None) for what in parts) if one]
            for part in ("body", "orelse"):
                if body := getattr(inner, part, None):
                    yield above, body


def _both(one: frozenset[str] | None, other: frozenset[str] | None) -> frozenset[str] | None:
    return other if one is None else one if other is None else one & other


def _stored(node: ast.AST) -> set[str]:
    """Returns the variables that are assigned within a node."""
    return {one.id for one in walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)}


def _leaves(body: Sequence[ast.stmt]) -> bool:
    """Returns whether statements never reach the one after them."""
    return bool(body) and (isinstance(body[-1], ast.Break | ast.Continue) or always_ends(body))


def always_ends(body: Sequence[ast.stmt]) -> bool:
    """Returns whether statements always end in a return, in an exception, or never; False also if that is unknown."""
    match body[-1] if body else None:
        case ast.Return() | ast.Raise():
            return True
        case ast.If(body=then, orelse=otherwise):
            return always_ends(then) and always_ends(otherwise)
        case ast.Match(cases=cases):
            default = isinstance(cases[-1].pattern, ast.MatchAs) and cases[-1].pattern.pattern is None
            return default and cases[-1].guard is None and all(always_ends(one.body) for one in cases)
        case ast.While(test=ast.Constant(value=value), body=loop) if value:
            return not any(map(_breaks, loop))
        case _:
            return False


def _breaks(node: ast.AST) -> bool:
    """Returns whether a statement of a loop may end it by a break, which is not one of a loop within."""
    if isinstance(node, ast.For | ast.While):
        return False
    return isinstance(node, ast.Break) or any(map(_breaks, ast.iter_child_nodes(node)))
