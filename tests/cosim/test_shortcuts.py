"""numba with shortcuts finds the same types, variables and lifetimes as without them."""

from __future__ import annotations

import functools
import importlib.util
import inspect
import math
import operator
import os
import warnings
from abc import ABCMeta
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

numba = pytest.importorskip("numba")

import llvmlite.binding as llvm  # noqa: E402
from llvmlite import ir as llvm_ir  # noqa: E402
from numba.core import (  # noqa: E402
    compiler,
    config,
    errors,
    event,
    ir,
    lowering,
    postproc,
    typed_passes,
    typeinfer,
    types,
    untyped_passes,
)
from numba.core.base import BaseContext  # noqa: E402
from numba.core.compiler_lock import global_compiler_lock  # noqa: E402
from numba.core.compiler_machinery import PassManager  # noqa: E402
from numba.core.registry import cpu_target  # noqa: E402
from numba.core.types.functions import BaseFunction  # noqa: E402
from numba.core.typing.context import BaseContext as TypingContext  # noqa: E402

from cosim import shortcuts  # noqa: E402
from cosim.kernel import kernel  # noqa: E402
from cosim.lowering import Library, link  # noqa: E402
from tests.cosim.forked import Forked  # noqa: E402

pytestmark = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")


def loops(values: Any, n: int) -> float:
    found = 0.0
    for i in range(n):
        for k in range(i):
            if values[k] > 1.0:
                continue
            found += math.sin(values[i]) * values[k] + min(i, k)
        values[1:3] = found
    print("found", found, values[0] if n else (n, found))
    return found if n > 3 else -found


def squares(n: int) -> Any:
    for i in range(n):
        yield i * i


@pytest.mark.parametrize("function", [loops, squares, lambda x: [math.floor(one) for one in (x, x + 1.0)]])
def test_variables_and_lifetimes(function: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """`_rec_list_vars` and `PostProcessor.run` of numba are the oracle."""

    def found() -> list[Any]:
        of = compiler.run_frontend(function)
        life = of.variable_lifetime
        every = [[(str(one), [v.name for v in one.list_vars()]) for one in b.body] for b in of.blocks.values()]
        return [every, life.livemap, life.usedefs, life.deadmaps]

    assert inspect.unwrap(ir.Inst._rec_list_vars) is not ir.Inst._rec_list_vars
    ours = found()
    assert any(names for block in ours[0] for _, names in block)
    monkeypatch.setattr(ir.Inst, "_rec_list_vars", list_vars)
    monkeypatch.setattr(postproc.PostProcessor, "run", shortcuts._run_postprocessor)
    assert found() == ours


def list_vars(self: Any, value: Any) -> list[Any]:
    """As numba 0.68 has it."""
    if isinstance(value, ir.Var):
        return [value]
    if isinstance(value, ir.Inst):
        return value.list_vars()
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [variable for one in value for variable in self._rec_list_vars(one)]
    return []


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (math.atan2, (types.float64, types.int64)),
        (max, (types.int64, types.float64, types.int32)),
        (np.sqrt, (types.Array(types.float32, 1, "C"),)),
        (range, (types.IntegerLiteral(3),)),
    ],
)
def test_a_call_is_resolved_once(function: Any, arguments: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    # An interpreted FMU that ran in this process has brought a copy of the module.
    monkeypatch.setattr(BaseFunction, "get_call_type", shortcuts._known_call_type)
    context = cpu_target.typing_context
    context.refresh()
    fresh = shortcuts._get_call_type(of := context.resolve_value_type(function), context, arguments, {})
    key = of.get_impl_key(fresh)
    assert of.get_call_type(context, arguments, {}) == fresh

    def never(*_: Any) -> None:
        raise AssertionError("resolved again")

    monkeypatch.setattr(shortcuts, "_get_call_type", never)
    of._impl_keys.clear()
    known = of.get_call_type(context, arguments, {})
    assert known == fresh and known.args == fresh.args
    assert type(of.get_impl_key(known)) is type(key)
    with pytest.raises(AssertionError, match="resolved again"):
        of.get_call_type(context, (*arguments, types.unicode_type), {})


def test_an_error_is_found_each_time() -> None:
    context = cpu_target.typing_context
    context.refresh()
    of = context.resolve_value_type(math.sin)
    assert isinstance(of, BaseFunction)
    texts = []
    for _ in range(2):
        with pytest.raises(errors.TypingError, match="No implementation of function") as raised:
            of.get_call_type(context, (types.unicode_type,), {})
        texts.append(str(raised.value).split())  # numba indents it more each time
    assert texts[0] == texts[1]


def test_an_extension_that_comes_later_counts() -> None:
    """A function that has been resolved gets another case, as modules that are imported later add them."""
    context = cpu_target.typing_context
    context.refresh()

    class Own(types.Type):  # type: ignore[misc]
        pass

    own = Own("own")
    of = context.resolve_value_type(math.cos)
    assert of.get_call_type(context, (types.float64,), {}).return_type == types.float64
    with pytest.raises(errors.TypingError):
        of.get_call_type(context, (own,), {})

    @numba.extending.overload(math.cos)
    def cos_of_own(x):  # type: ignore[no-untyped-def]
        return (lambda x: 42.0) if isinstance(x, Own) else None

    context.refresh()
    later = context.resolve_value_type(math.cos)
    assert later.get_call_type(context, (types.float64,), {}).return_type == types.float64
    templates = [one.key for one in later.templates]
    assert len(templates) > len(of.templates)


def test_types_of_constants(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that numba finds by trying all kinds one after the other."""
    monkeypatch.setattr(TypingContext, "resolve_value_type", shortcuts._known_value_type)
    context = cpu_target.typing_context
    context.refresh()
    values = [math.sin, operator.add, len, max, clipped, (1, 2.0), 3, 2.5, True, float, range, np.float32, np, "x"]
    for value in values:
        found = context.resolve_value_type(value)
        assert found == shortcuts._resolve_value_type(context, value), value
    with pytest.raises(ValueError, match=r"Cannot determine Numba type of .*builtin_function"):
        context.resolve_value_type(operator.length_hint)
    monkeypatch.setattr(shortcuts, "_resolve_value_type", None)
    assert [str(context.resolve_value_type(value)) for value in (math.sin, clipped)] == [
        "Function(<built-in function sin>)",
        f"type({clipped})",
    ]


def test_declarations_are_loaded_when_there_are_new_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(cpu_target.target_context), "refresh", shortcuts._refresh)
    monkeypatch.setattr(type(cpu_target.typing_context), "refresh", shortcuts._refresh_typing)
    loaded: list[str] = []

    def counted(name: str) -> Callable[[Any], None]:
        real = getattr(shortcuts, name)

        def load(context: Any) -> None:
            loaded.append(name)
            real(context)

        return load

    target = cpu_target.target_context
    target.refresh()
    for name in ("_refresh_functions", "_refresh_types"):
        monkeypatch.setattr(shortcuts, name, counted(name))
    target.refresh()
    assert loaded == []

    @numba.extending.overload(clipped.py_func)  # type: ignore[attr-defined]  # of types
    def clipped_too(x):  # type: ignore[no-untyped-def]
        return lambda x: x

    target.refresh()
    assert loaded == ["_refresh_types"]

    @numba.extending.lower_builtin(clipped.py_func, types.float64)  # type: ignore[attr-defined]  # of functions
    def clipped_as_well(*_: Any) -> None: ...

    target.refresh()
    target.refresh()
    assert loaded == ["_refresh_types", "_refresh_functions"]
    assert target._defns[clipped.py_func].versions  # type: ignore[attr-defined]


def test_other_users_of_numba() -> None:
    """Generators, and functions that stay with Python's objects, which need numba's full post-processing."""

    @numba.njit
    def total(n):  # type: ignore[no-untyped-def]
        found = 0
        for one in numba_squares(n):
            found += one
        return found

    numba_squares = numba.njit(squares)
    assert total(5) == 30

    @numba.jit(forceobj=True)
    def words(n):  # type: ignore[no-untyped-def]
        found = {}
        for i in range(n):
            if i % 2:
                found[i] = [str(k) for k in range(i)]
        return found

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numba says that it falls back to Python's objects
        assert words(4) == {1: ["0"], 3: ["0", "1", "2"]}


@pytest.mark.parametrize("counted", [True, False])
def test_ends_of_variables_are_marked_where_references_are_counted(
    counted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The machine code is that of numba's own pass, which marks them everywhere."""
    seen = lowered_by_numba(monkeypatch)
    monkeypatch.setattr(typed_passes.IRLegalization, "run_pass", shortcuts._legalize_kernel)
    ours = compiled(sums, _nrt=counted)
    assert (ir.Del in seen) is counted
    assert ir.Branch in seen and ir.Assign not in seen
    monkeypatch.setattr(typed_passes.IRLegalization, "run_pass", shortcuts._legalize)
    monkeypatch.setattr(lowering.Lower, "lower_inst", shortcuts._lower)
    assert compiled(sums, _nrt=counted) == ours
    assert {ir.Del, ir.Assign} <= seen


def test_debuggers_get_the_text_of_each_instruction(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = lowered_by_numba(monkeypatch)
    monkeypatch.setattr(config, "DEBUG_JIT", 1)
    compiled(sums)
    assert ir.Assign in seen


def lowered_by_numba(monkeypatch: pytest.MonkeyPatch) -> set[type]:
    """Kinds of instructions that reach numba's own method from now on."""
    seen, original = set[type](), shortcuts._lower

    def watched(self: Any, instruction: Any) -> None:
        seen.add(type(instruction))
        original(self, instruction)

    monkeypatch.setattr(shortcuts, "_lower", watched)
    monkeypatch.setattr(lowering.Lower, "lower_inst", shortcuts._lower_instruction)
    return seen


def test_kinds_of_types() -> None:
    """Python's search for virtual subclasses is the oracle."""
    kinds, waiting = set[Any](), [types.Type]
    while waiting:
        if (kind := waiting.pop()) not in kinds:
            kinds.add(kind)
            waiting += type.__subclasses__(kind)
    some = [types.float64, types.IntegerLiteral(3), types.Array(types.int32, 1, "C"), RECORD, 2.5, types.Float]
    assert type(types.Type).__instancecheck__ is type.__instancecheck__
    for kind in kinds:
        assert [isinstance(one, kind) for one in some] == [ABCMeta.__instancecheck__(kind, one) for one in some]
        assert [one for one in kinds if issubclass(one, kind)] == [
            one for one in kinds if ABCMeta.__subclasscheck__(kind, one)
        ]
    assert len(kinds) > 50


# ---- linear algebra ----

MATRICES = """
import sys
import numba, numpy as np
from numba.np import arraymath, linalg
from cosim import kernel

@kernel
def doubled(x):
    return 2.0 * x

@numba.njit
def product(a, b):
    return np.dot(a, b)

print(doubled(1.5), arraymath._HAVE_BLAS, linalg.ensure_blas.__name__, "scipy.linalg" in sys.modules)
print(product(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([1.0, 10.0])), "scipy.linalg" in sys.modules)
"""


def test_linear_algebra_is_imported_by_those_who_use_it(forked_builder: Forked) -> None:
    done = forked_builder.run(MATRICES)
    assert done.stdout.splitlines() == ["3.0 True ensure_blas False", "[21. 43.] True"], done.stderr


def test_without_scipy_numba_says_so_and_knows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise ImportError("scipy is required")

    monkeypatch.setattr(shortcuts, "_ensure_blas", refuse)
    monkeypatch.setattr(shortcuts.linalg, "ensure_blas", shortcuts._find_blas)
    shortcuts._find_blas()
    assert shortcuts.linalg.ensure_blas is refuse
    monkeypatch.setattr(shortcuts, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match="scipy is required"):
        shortcuts._find_blas()


# ---- rewrites ----

RECORD = numba.from_dtype(np.dtype([("x", "f8")]))


def with_arrays(values: Any, _: Any) -> Any:
    return (values + 1.0 - 2.0 * values).sum()


def with_ufunc(values: Any, _: Any) -> Any:
    return np.sqrt(values).sum()


def with_list(values: Any, _: Any) -> Any:
    return np.array([1.0, 2.0, values[0]]).sum()


def with_field(record: Any, name: str) -> Any:
    record[name] = record[name] + 1.0
    return record.x


def with_none_of_them(values: Any, record: Any) -> Any:
    part = values[1:]
    part[0] = record.x
    record["x"] = part[0] * 2.0
    return part[0] + record["x"]


@pytest.mark.parametrize(
    ("function", "is_rewritten"),
    [(with_arrays, True), (with_ufunc, True), (with_list, True), (with_field, True), (with_none_of_them, False)],
)
def test_functions_with_something_to_rewrite_are_rewritten(
    function: Callable[..., Any], is_rewritten: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The machine code is that of numba's own pass, which runs only if a statement may be rewritten."""
    seen = []

    def watched(self: Any, state: Any) -> bool:
        if state.func_id.func_name == function.__name__:
            seen.append(state.func_id.func_name)
        return bool(original(self, state))

    original = inspect.unwrap(typed_passes.NopythonRewrites.run_pass)
    monkeypatch.setattr(shortcuts, "_rewrite", watched)
    monkeypatch.setattr(typed_passes.NopythonRewrites, "run_pass", shortcuts._rewrite_typed)
    arguments = types.Array(types.float64, 1, "C"), RECORD
    if function is with_field:
        arguments = RECORD, types.literal("x")
    ours = compiled(function, arguments)
    assert bool(seen) is is_rewritten
    monkeypatch.setattr(typed_passes.NopythonRewrites, "run_pass", original)
    assert compiled(function, arguments) == ours


# ---- closures ----


def with_closure(values: Any, _: Any) -> Any:
    def more(x: float) -> float:
        return x + 1.0

    return more(values[0])


def with_comprehension(values: Any, _: Any) -> Any:
    return np.array([2.0 * x for x in values])[0]


def with_appended(values: Any, _: Any) -> Any:
    found = [values[0]]
    for i in range(3):
        found.append(values[i])
    return np.array(found)[0]


@numba.stencil
def neighbours(a):  # type: ignore[no-untyped-def]
    return a[-1] + a[1]


def with_stencil(values: Any, _: Any) -> Any:
    return neighbours(values)[1]


@pytest.mark.parametrize(
    ("function", "is_inlined"),
    [
        (with_closure, True),
        (with_comprehension, True),
        (with_appended, True),
        (with_stencil, True),
        (with_none_of_them, False),
    ],
)
def test_functions_with_something_to_inline_are_looked_through(
    function: Callable[..., Any], is_inlined: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def watched(self: Any, state: Any) -> bool:
        seen.append(state.func_id.func_name)
        return bool(original(self, state))

    original = inspect.unwrap(untyped_passes.InlineClosureLikes.run_pass)
    monkeypatch.setattr(shortcuts, "_inline", watched)
    monkeypatch.setattr(untyped_passes.InlineClosureLikes, "run_pass", shortcuts._inline_closures)
    arguments = types.Array(types.float64, 1, "C"), RECORD
    ours = compiled(function, arguments)
    assert (function.__name__ in seen) is is_inlined
    monkeypatch.setattr(untyped_passes.InlineClosureLikes, "run_pass", original)
    assert compiled(function, arguments) == ours


# ---- sizes and arguments ----


def test_sizes_of_types(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BaseContext, "get_abi_sizeof", shortcuts._known_size)
    context = cpu_target.target_context
    pair = llvm_ir.LiteralStructType([llvm_ir.IntType(8), llvm_ir.DoubleType()])
    every = {llvm_ir.IntType(1): 1, pair: 16, llvm_ir.ArrayType(pair, 3): 48, llvm_ir.PointerType(): 8}
    for _ in range(2):
        assert {one: context.get_abi_sizeof(one) for one in every} == every
        monkeypatch.setattr(shortcuts, "_get_size", None)
    named = llvm_ir.Context().get_identified_type("one")
    named.set_body(llvm_ir.DoubleType())
    monkeypatch.setattr(shortcuts, "_get_size", lambda context, one: 77)
    assert context.get_abi_sizeof(named) == 77  # another one of that name may have another size


def test_a_second_copy_of_the_module_finds_numbas_own() -> None:
    """An interpreted FMU brings one."""
    spec = importlib.util.spec_from_file_location("shortcuts_again", shortcuts.__file__)
    assert spec is not None and spec.loader is not None
    again = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(again)
    every = [name for name, value in vars(shortcuts).items() if callable(value) and "numba" in value.__module__]
    own = [name for name in every if inspect.unwrap(getattr(shortcuts, name)) is getattr(shortcuts, name)]
    assert {
        "_get_call_type",
        "_resolve_value_type",
        "_inline",
        "_get_size",
        "_end_event",
        "_ensure_blas",
        "_own_catch",
    } <= {*own}
    assert [name for name in own if getattr(again, name) is not getattr(shortcuts, name)] == []
    assert again._disabled.func is shortcuts._disabled.func


def with_loc(a: Any, loc: Any = None) -> None: ...


def with_keyword(a: Any, *, loc: Any) -> None: ...


def with_all(*loc: Any) -> None: ...


def with_named(a: Any, **loc: Any) -> None: ...


def with_local(a: Any) -> Any:
    loc = a
    return loc


@functools.wraps(with_loc)
def wrapping(*arguments: Any) -> None: ...


@pytest.mark.parametrize(
    "function",
    [
        *(with_loc, with_keyword, with_all, with_named, with_local, wrapping),
        *(functools.partial(with_loc, 1), functools.partial(with_local, 1), with_none_of_them),
    ],
)
def test_who_takes_a_place(function: Callable[..., Any]) -> None:
    assert shortcuts._has_loc(function) is ("loc" in inspect.signature(function).parameters)


# ---- passes ----


def plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Passes run, and errors get their contexts, as numba does it: the oracle."""
    monkeypatch.setattr(PassManager, "_runPass", global_compiler_lock(shortcuts._own_run_pass))
    monkeypatch.setattr(PassManager, "dependency_analysis", shortcuts._own_analysis)
    monkeypatch.setattr(errors.WarningsFixer, "catch_warnings", contextmanager(shortcuts._own_catch))
    for module in (errors, lowering, typeinfer):
        monkeypatch.setattr(module, "new_error_context", contextmanager(shortcuts._ErrorContext.__wrapped__))


def test_passes_make_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = compiled(sums)
    assert ours.count("\n") > 50
    plainly(monkeypatch)
    assert compiled(sums) == ours


def sums(values: Any, n: int) -> float:
    found = 0.0
    for i in range(n):
        for k in range(i):
            if values[k] > 1.0:
                continue
            found += math.sin(values[i]) * values[k] + min(i, k)
        values[1:3] = found
    return found if n > 3 else -found


def compiled(
    function: Callable[..., Any],
    arguments: tuple[Any, ...] = (types.Array(types.float64, 1, "C"), types.int64),
    **options: Any,
) -> str:
    """Lines of the machine code of a function, without its names, in which numba counts compilations."""
    dispatcher = numba.njit(function, **options)
    dispatcher.compile(arguments)
    (text,) = dispatcher.inspect_asm().values()
    return "\n".join(line for line in text.splitlines() if line.startswith("\t") and "_ZN" not in line)


def of_wrong_type(x: float) -> Any:
    y = x + 1.0
    return math.sin(str(y))  # type: ignore[arg-type]


def of_unknown_name(x: float) -> Any:
    return missing_in_this_module(x)  # type: ignore[name-defined]  # noqa: F821


@pytest.mark.parametrize("function", [of_wrong_type, of_unknown_name])
def test_errors_tell_the_same(function: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def told() -> list[str]:
        with pytest.raises(errors.TypingError) as raised:
            numba.njit(function).compile((types.float64,))
        return str(raised.value).split()  # numba indents it more each time

    ours = told()
    assert {"During:", "Pass", "nopython_type_inference"} <= {*ours}
    plainly(monkeypatch)
    assert told() == ours


def test_passes_need_what_numba_finds() -> None:
    state = compiler.StateDict(flags=compiler.DEFAULT_FLAGS, func_ir=None)
    every = [
        getattr(compiler.DefaultPassBuilder, f"define_{kind}_pipeline")(state)
        for kind in ("nopython", "untyped", "typed", "nopython_lowering", "objectmode")
    ]
    assert len({tuple(one.passes) for one in every}) == 5
    for one in every * 2:
        assert one.dependency_analysis() == shortcuts._own_analysis(one)


def test_warnings_are_kept_with_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    def kept() -> tuple[Any, ...]:
        fixer = errors.WarningsFixer(errors.NumbaWarning)
        with warnings.catch_warnings(record=True) as passed:
            warnings.simplefilter("always")
            with fixer.catch_warnings("model.py", 7):
                warnings.warn_explicit(errors.NumbaWarning("here"), errors.NumbaWarning, "numba.py", 1)
                warnings.warn_explicit("of others", UserWarning, "other.py", 2)
            with fixer.catch_warnings():
                warnings.warn_explicit(errors.NumbaPerformanceWarning("a"), errors.NumbaPerformanceWarning, "a.py", 3)
                warnings.warn_explicit(errors.NumbaWarning("b"), errors.NumbaWarning, "b.py", 4)
            with pytest.raises(ZeroDivisionError), fixer.catch_warnings("model.py", 8):
                warnings.warn_explicit(errors.NumbaWarning("lost"), errors.NumbaWarning, "numba.py", 5)
                1 / 0  # noqa: B018
        return dict(fixer._warnings), [(str(one.message), one.filename, one.lineno) for one in passed]

    ours = kept()
    assert ("model.py", 7, errors.NumbaWarning) in ours[0]
    assert ours[1] == [("of others", "other.py", 2)]
    plainly(monkeypatch)
    assert kept() == ours


def test_calls_of_a_kernel_share_their_template() -> None:
    of_floats, again, of_ints = (
        clipped.get_call_template((one,), {})[0] for one in (*2 * [types.float64], types.int64)
    )  # type: ignore[attr-defined]
    assert of_floats is again
    assert [one.cases[0].args for one in (of_floats, of_ints)] == [(types.float64,), (types.int64,)]


def test_who_watches_passes_sees_them() -> None:
    with event.install_recorder("numba:run_pass") as seen:
        numba.njit(lambda x: x + 1.0).compile((types.float64,))
    names = [one.data["name"].split()[0] for _, one in seen.buffer if one.is_start]
    assert {"nopython_type_inference", "native_lowering"} <= {*names}


@pytest.mark.parametrize("kind", ["numba:llvm_lock", "numba:compiler_lock"])
def test_who_watches_locks_sees_them(kind: str) -> None:
    with event.install_recorder(kind) as seen:
        numba.njit(lambda x: x + 1.0).compile((types.float64,))
    began, ended = ([one for _, one in seen.buffer if getattr(one, which)] for which in ("is_start", "is_end"))
    assert len(began) == len(ended) > 10


# ---- linking ---------------------------------------------------------------------------------------------------------


@kernel
def clipped(x: float) -> float:
    return min(max(x, -1.0), 1.0)


@kernel
def waved(x: float) -> float:
    return math.sin(clipped(x)) + int(x) % 3


@kernel
def mixed(x: float) -> float:
    return waved(x) * clipped(x + 0.5) + divmod(x, 2.0)[1]


def test_pairs_are_linked_as_one_after_the_other() -> None:
    """The same functions in the same order; LLVM makes the same machine code of them."""
    lowered = mixed.lower((types.float64,))  # type: ignore[attr-defined]
    found: dict[Any, None] = {}
    waiting = [lowered.library]
    while waiting:
        if (one := waiting.pop()) not in found:
            found[one] = None
            waiting += reversed(one._linking_libraries if isinstance(one, Library) else [])
    first, *others = (one._final_module if isinstance(one, Library) else one._get_module_for_linking() for one in found)
    assert len(others) >= 3
    assert any(not isinstance(one, Library) for one in found)  # functions of numba, dropped where nobody calls them
    wanted = first.clone()
    for other in others:
        wanted.link_in(other, preserve=True)
    made = link([lowered.library])
    defined = [[f.name for f in module.functions if not f.is_declaration] for module in (wanted, made)]
    assert [name for name in defined[1] if name in defined[0]] == defined[0]
    assert code_of(made, lowered.name) == code_of(wanted, lowered.name)


def code_of(module: Any, entry: str) -> str:
    """Assembly of the function and all that it needs, without names of constants."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(opt=3)
    for one in (*module.functions, *module.global_variables):
        if not one.is_declaration and one.name != entry and one.linkage != llvm.Linkage.common:
            one.linkage = "internal"
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    passes.getModulePassManager().run(module, passes)
    lines = machine.emit_assembly(module).splitlines()
    return "\n".join(line for line in lines if line.startswith("\t") and not line.startswith("\t."))
