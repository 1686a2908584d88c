"""Shortcuts in numba's compiler: the same types, the same IR and the same machine code in less time.

numba finds out again and again what it knows already or what nobody asks for: the type of a call, although a thousand
functions add the same two floats; which variables are alive after each of its passes, although only the last result is
used; whether a function that has nothing to rewrite or to inline has something; whether extensions have new
declarations; which passes need which others; who watches each pass and each lock; the size of a type, by a module of
LLVM of its own; where variables end whose references nobody counts; each instruction as text; and whether SciPy's
linear algebra is installed, by importing it. `use` replaces these.
"""

from __future__ import annotations

import sys
import warnings
from functools import cached_property, partial, wraps
from importlib.util import find_spec
from inspect import unwrap
from types import BuiltinFunctionType, FunctionType
from typing import Any

from numba.core import (
    base,
    config,
    errors,
    event,
    ir,
    ir_utils,
    lowering,
    postproc,
    transforms,
    typed_passes,
    typeinfer,
    untyped_passes,
)
from numba.core.base import BaseContext
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager, pass_timings
from numba.core.dispatcher import Dispatcher
from numba.core.interpreter import Interpreter
from numba.core.ir_utils import fixup_var_define_in_scope
from numba.core.registry import cpu_target
from numba.core.rewrites.registry import rewrite_registry
from numba.core.types import Array, StringLiteral, Type
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext as TypingContext
from numba.np import linalg

from cosim.deferred import InModule, compiled

__all__ = ["use"]


# ---- types of calls --------------------------------------------------------------------------------------------------

_get_call_type: Any = unwrap(BaseFunction.get_call_type)  # numba's own, also in a second copy of this module
_call_types: dict[tuple[Any, ...], tuple[Any, Any]] = {}


@wraps(_get_call_type)
def _known_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Returns the signature for arguments of these types: that of before, if the function was called with them.

    An error is found anew, with its message. A function to which an extension adds a case is another object.
    """
    key = (self, context, tuple(args), tuple(kws.items()))
    if (found := _call_types.get(key)) is None:
        signature = _get_call_type(self, context, args, kws)
        found = _call_types[key] = signature, self.get_impl_key(signature)
    signature, implementation = found
    self._impl_keys[signature.args] = implementation  # as numba leaves it: the last resolution counts
    return signature


# ---- types of values ------------------------------------------------------------------------------------------------

_resolve_value_type: Any = unwrap(TypingContext.resolve_value_type)


@wraps(_resolve_value_type)
def _known_value_type(self: Any, value: Any) -> Any:
    """Returns the type of a constant: that of a kernel and of a declared function without trying all others first."""
    value = _resolved(value)  # an attribute of a module
    if isinstance(value, Dispatcher):
        return value._numba_type_
    if type(value) is BuiltinFunctionType and (found := self._get_global_type(value)) is not None:
        return found
    return _resolve_value_type(self, value)


_get_global: Any = unwrap(Interpreter.get_global_value)
_get_closure: Any = unwrap(Interpreter.get_closure_value)


@wraps(_get_global)
def _global_value(self: Any, name: str) -> Any:
    """Returns the value of a name of the function's module; of a stand-in, what it stands for."""
    return _resolved(_get_global(self, name))


@wraps(_get_closure)
def _closure_value(self: Any, index: int) -> Any:
    """Returns the value of a name of an enclosing function; of a stand-in, what it stands for."""
    return _resolved(_get_closure(self, index))


_in_modules: set[int] = set()


def _resolved(value: Any) -> Any:
    """Returns what a stand-in stands for; numba then knows what the module declares that defines it."""
    found = compiled(value)
    if isinstance(value, InModule) and id(value) not in _in_modules:
        _in_modules.add(id(value))
        cpu_target.target_context.refresh()
    return found


# ---- variables -------------------------------------------------------------------------------------------------------


@wraps(unwrap(ir.Inst._rec_list_vars))
def _list_variables(_: Any, value: Any) -> list[Any]:
    """Returns the variables in a value of numba's IR, in numba's order."""
    found: list[Any] = []
    _collect(value, found)
    return found


def _collect(value: Any, found: list[Any]) -> None:
    kind = type(value)
    how = _HOW.get(kind)
    if how is None:
        how = _HOW[kind] = next((way for base, way in _WAYS if issubclass(kind, base)), _NOTHING)
    if how == _VARIABLE:
        found.append(value)
    elif how == _EXPRESSION:
        for one in value._kws.values():
            _collect(one, found)
    elif how == _SEQUENCE:
        for one in value:
            _collect(one, found)
    elif how == _MAPPING:
        for one in value.values():
            _collect(one, found)
    elif how == _INSTRUCTION:
        found.extend(value.list_vars())


_NOTHING, _VARIABLE, _EXPRESSION, _INSTRUCTION, _SEQUENCE, _MAPPING = range(6)
_WAYS: tuple[tuple[Any, int], ...] = (
    (ir.Var, _VARIABLE),
    (ir.Inst, _INSTRUCTION),
    ((list, tuple), _SEQUENCE),
    (dict, _MAPPING),
)
_HOW: dict[type, int] = {ir.Expr: _EXPRESSION}
"""How variables are found in values of a type; filled as types are met."""


_run_postprocessor = unwrap(postproc.PostProcessor.run)


@wraps(_run_postprocessor)
def _postprocess(self: Any, emit_dels: bool = False, **options: Any) -> None:
    """Leaves the lifetimes of variables to those who ask for them, unless `del` instructions are to be made of them."""
    function = self.func_ir
    if emit_dels or function.is_generator:
        _run_postprocessor(self, emit_dels, **options)
        return
    function.blocks = transforms.canonicalize_cfg(function.blocks)
    function.variable_lifetime = postproc.VariableLifetime(function.blocks)
    function.generator_info = None


_legalize: Any = unwrap(typed_passes.IRLegalization.run_pass)


@wraps(_legalize)
def _legalize_kernel(self: Any, state: Any) -> bool:
    """Checks the IR of a function before it is lowered; ends of variables are marked only where references count."""
    flags, function = state.flags, state.func_ir
    if flags.nrt or flags.enable_pyobject or flags.force_pyobject or function.is_generator:
        return bool(_legalize(self, state))
    ir_utils.enforce_no_phis(function)
    ir_utils.enforce_no_dels(function)
    postproc.PostProcessor(function).run()
    return True


# ---- rewrites --------------------------------------------------------------------------------------------------------

_rewrite: Any = unwrap(typed_passes.NopythonRewrites.run_pass)
_KNOWN = {"RewriteStringLiteralGetitems", "RewriteStringLiteralSetitems", "RewriteArrayOfConsts", "RewriteArrayExprs"}


@wraps(_rewrite)
def _rewrite_typed(self: Any, state: Any) -> bool:
    """Rewrites expressions of whole arrays and fields named by text, if the function may have some."""
    known = {one.__name__ for one in rewrite_registry.rewrites["after-inference"]} <= _KNOWN
    statements = (one for block in state.func_ir.blocks.values() for one in block.body)
    if known and not any(map(partial(_may_be_rewritten, state.typemap), statements)):
        return True
    return bool(_rewrite(self, state))


def _may_be_rewritten(types: Any, statement: Any) -> bool:
    """Returns whether a statement makes an array, or gets or sets an item whose index is text."""
    if isinstance(statement, ir.SetItem):
        return isinstance(types[statement.index.name], StringLiteral)
    value = statement.value if isinstance(statement, ir.Assign) else None
    if not isinstance(value, ir.Expr):
        return False
    if value.op == "getitem":
        return isinstance(types[value.index.name], StringLiteral)
    return value.op in ("unary", "binop", "call") and isinstance(types.get(statement.target.name), Array)


# ---- closures --------------------------------------------------------------------------------------------------------

_inline: Any = unwrap(untyped_passes.InlineClosureLikes.run_pass)
_INLINED = {"reduce", "stencil"}


@wraps(_inline)
def _inline_closures(self: Any, state: Any) -> bool:
    """Inlines closures, comprehensions, reductions and stencils, if the function may have some."""
    function = state.func_ir
    statements = (one for block in function.blocks.values() for one in block.body)
    if function.is_generator or any(map(_may_be_inlined, statements)):
        return bool(_inline(self, state))
    postproc.PostProcessor(function).run()
    fixup_var_define_in_scope(function.blocks)
    return True


def _may_be_inlined(statement: Any) -> bool:
    """Returns whether a statement makes a function or a list, or names something that numba inlines."""
    value = statement.value if isinstance(statement, ir.Assign) else None
    if isinstance(value, ir.Expr):
        return value.op in ("make_function", "build_list") or (value.op == "getattr" and value.attr in _INLINED)
    if isinstance(value, ir.Global | ir.FreeVar):
        of = value.value
        plain = isinstance(of, Dispatcher | int | float) or (
            type(of) is BuiltinFunctionType and of.__name__ not in _INLINED
        )
        return not plain and (of is list or getattr(of, "__name__", "stencil") in _INLINED)
    return False


# ---- sizes and arguments ---------------------------------------------------------------------------------------------

_get_size: Any = unwrap(BaseContext.get_abi_sizeof)
_sizes: dict[tuple[str, str], int] = {}


@wraps(_get_size)
def _known_size(self: Any, type_: Any) -> int:
    """Returns the size of a type of LLVM: that of before, unless it is known by its name only."""
    text = str(type_)
    if "%" in text:
        return int(_get_size(self, type_))
    key = str(self.target_data), text
    if (found := _sizes.get(key)) is None:
        found = _sizes[key] = int(_get_size(self, type_))
    return found


_own_has_loc: Any = unwrap(base._has_loc)


@wraps(_own_has_loc)
def _has_loc(function: Any) -> bool:
    """Returns whether a function takes an argument called loc; a plain one is asked without making its signature."""
    if type(function) is not FunctionType or function.__dict__.keys() & {"__wrapped__", "__signature__"}:
        return bool(_own_has_loc(function))
    code = function.__code__
    more = bool(code.co_flags & 0x04) + bool(code.co_flags & 0x08)  # *arguments, **named
    return "loc" in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + more]


_own: Any = lowering.Lower.__dict__["_disable_sroa_like_opt"]
_disabled = cached_property(_own.func if isinstance(_own, cached_property) else _own.fget)
_disabled.__set_name__(lowering.Lower, "_disable_sroa_like_opt")
"""Whether a function is compiled for a debugger: asked for each instruction, the same for all."""


_lower: Any = unwrap(lowering.Lower.lower_inst)
_config: Any = config  # whose names are made as it is read


@wraps(_lower)
def _lower_instruction(self: Any, instruction: Any) -> None:
    """Lowers an instruction. Of an assignment, which most are, no text is made for a debugger that nobody runs."""
    if type(instruction) is not ir.Assign or _config.DEBUG_JIT:
        _lower(self, instruction)
        return
    self.debuginfo.mark_location(self.builder, self.loc.line)
    self.notify_loc(self.loc)
    name, value = instruction.target.name, instruction.value
    lowered = self.lower_assign(self.typeof(name), instruction)
    argument = None
    if isinstance(value, ir.Arg):
        self.debuginfo.mark_location(self.builder, self.defn_loc.line)
        argument = value.index + 1
    self.storevar(lowered, name, argidx=argument)


# ---- declarations ----------------------------------------------------------------------------------------------------

_refresh_functions: Any = unwrap(BaseContext.refresh)
_refresh_types: Any = unwrap(TypingContext.refresh)


def _has_new(context: Any) -> bool:
    """Returns whether a registry that `context` knows has grown since it was asked last; registries never shrink."""
    every = context._registries.items()
    declared = sum(len(getattr(registry, kind)) for registry, loader in every for kind in loader.registry_items)
    known, context.declared = getattr(context, "declared", None), declared
    return bool(known != declared)


@wraps(_refresh_functions)
def _refresh(self: Any) -> None:
    """Loads new declarations, if there are any, of functions and their types."""
    if _has_new(self):
        _refresh_functions(self)
        _has_new(self)
    else:
        self.typing_context.refresh()


@wraps(_refresh_types)
def _refresh_typing(self: Any) -> None:
    """Loads new declarations of types, if there are any."""
    if _has_new(self):
        _refresh_types(self)
        _has_new(self)


# ---- passes ----------------------------------------------------------------------------------------------------------

_own_run_pass: Any = unwrap(PassManager._runPass)
_NO_TIME = pass_timings(0.0, 0.0, 0.0)
_errors: Any = errors  # with names that it does not export


class _ErrorContext:
    """Adds a description to an error of numba; numba's own context is a generator, and there are 500 for a function."""

    __slots__ = ("_arguments", "_format", "_named")
    __wrapped__: Any = unwrap(_errors.new_error_context)

    def __init__(self, format_: str, *arguments: Any, **named: Any) -> None:
        place = named.get("loc")
        if place is not None and not place.filename.startswith(_errors._numba_path):
            _errors.loc_info.update(named)
        self._format, self._arguments, self._named = format_, arguments, named

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, errors.NumbaError):
            error.add_context(_errors._format_msg(self._format, self._arguments, self._named))


_own_analysis: Any = unwrap(PassManager.dependency_analysis)
_analyses: dict[tuple[Any, ...], Any] = {}


@wraps(_own_analysis)
def _known_analysis(self: Any) -> Any:
    """Returns which passes need which others: that of before, if another function was compiled by the same passes."""
    passes = tuple(one for one, _ in self.passes)
    if (found := _analyses.get(passes)) is None:
        found = _analyses[passes] = _own_analysis(self)
    return found


@wraps(_own_run_pass)
def _run_pass(self: Any, index: int, one: Any, state: Any) -> None:
    """Runs a pass; its types and flags are described, and its result is looked through, only if somebody watches."""
    with global_compiler_lock:
        if self._ENFORCING or _watched(self):
            _own_run_pass(self, index, one, state)
            return
        one.analysis = self._analysis
        with _ErrorContext("Pass {name}", name=one.name()):
            one.run_initialization(state)
            one.run_pass(state)
            one.run_finalizer(state)
        self.exec_times[f"{index}_{one.name()}"] = _NO_TIME


_own_catch: Any = unwrap(_errors.WarningsFixer.catch_warnings)


class _CaughtWarnings:
    """Keeps the warnings of a part of type inference; numba's own context is a generator, in one of the library's."""

    __slots__ = ("_caught", "_fixer", "_found", "_place")

    def __init__(self, fixer: Any, place: tuple[str | None, int | None]) -> None:
        self._fixer, self._place = fixer, place

    def __enter__(self) -> None:
        self._caught = warnings.catch_warnings(record=True)
        self._found: Any = self._caught.__enter__()
        warnings.simplefilter("always", self._fixer._category)

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._caught.__exit__(kind, error, trace)
        if error is not None:
            return
        filename, line = self._place
        for one in self._found:
            if issubclass(one.category, self._fixer._category):
                filename, line = filename or one.filename, line or one.lineno  # as numba does it: the first one's
                self._fixer._warnings[filename, line, one.category].add(str(one.message))
            else:
                warnings.warn_explicit(str(one.message), one.category, one.filename, one.lineno)


@wraps(_own_catch)
def _catch_warnings(self: Any, filename: str | None = None, lineno: int | None = None) -> _CaughtWarnings:
    """Keeps the warnings of what is done within, with a place of the function that is compiled."""
    return _CaughtWarnings(self, (filename, lineno))


def _watched(manager: Any) -> bool:
    return bool(
        event._registered.get("numba:run_pass") or manager._print_before or manager._print_after or manager._print_wrap
    )


_start_event: Any = unwrap(event.start_event)
_end_event: Any = unwrap(event.end_event)


@wraps(_start_event)
def _start(kind: str, data: Any = None) -> None:
    """Tells that something begins, such as the use of LLVM, if somebody listens."""
    if event._registered.get(kind):
        _start_event(kind, data)


@wraps(_end_event)
def _end(kind: str, data: Any = None, exc_details: Any = None) -> None:
    """Tells that something ends, if somebody listens."""
    if event._registered.get(kind):
        _end_event(kind, data, exc_details)


# ---- linear algebra --------------------------------------------------------------------------------------------------

_ensure_blas: Any = unwrap(linalg.ensure_blas)


@wraps(_ensure_blas)
def _find_blas() -> None:
    """Returns, once, if SciPy is installed, where numba asks so; whoever compiles a product of matrices imports it.

    Raises:
        ImportError: SciPy is not installed.
    """
    linalg.ensure_blas = _ensure_blas
    if find_spec("scipy") is None:
        _ensure_blas()


def use() -> None:
    """Replaces functions of numba by those of this module, for every function that this process compiles."""
    kinds: Any = type(Type)  # numba registers no class as a virtual subclass, which is what an ABCMeta looks for
    kinds.__instancecheck__, kinds.__subclasscheck__ = type.__instancecheck__, type.__subclasscheck__
    setattr(BaseFunction, "get_call_type", _known_call_type)  # noqa: B010 (numba is typed in part)
    setattr(TypingContext, "resolve_value_type", _known_value_type)  # noqa: B010
    setattr(Interpreter, "get_global_value", _global_value)  # noqa: B010
    setattr(Interpreter, "get_closure_value", _closure_value)  # noqa: B010
    ir.Inst._rec_list_vars = _list_variables
    postproc.PostProcessor.run = _postprocess
    typed_passes.IRLegalization.run_pass = _legalize_kernel
    typed_passes.NopythonRewrites.run_pass = _rewrite_typed
    untyped_passes.InlineClosureLikes.run_pass = _inline_closures
    setattr(BaseContext, "get_abi_sizeof", _known_size)  # noqa: B010
    base._has_loc = _has_loc
    setattr(lowering.Lower, "_disable_sroa_like_opt", _disabled)  # noqa: B010
    setattr(lowering.Lower, "lower_inst", _lower_instruction)  # noqa: B010
    event.start_event, event.end_event = _start, _end
    setattr(BaseContext, "refresh", _refresh)  # noqa: B010
    setattr(TypingContext, "refresh", _refresh_typing)  # noqa: B010
    setattr(PassManager, "_runPass", _run_pass)  # noqa: B010
    setattr(PassManager, "dependency_analysis", _known_analysis)  # noqa: B010
    _errors.WarningsFixer.catch_warnings = _catch_warnings
    for module in (errors, lowering, typeinfer):
        setattr(module, "new_error_context", _ErrorContext)  # noqa: B010
    if "numba.np.arraymath" not in sys.modules:  # which asks when it is imported
        linalg.ensure_blas = _find_blas
