"""Checked kernels: array indices, divisions by zero, endless loops, and fields accessed by offset.

A checked kernel is the author's function, compiled by numba with additional passes. In this function and in every
function that it calls, an index outside its array causes an error instead of an access to adjacent memory. The error
gives the source file, the line, and the array as written in the source: ``gauge.py:12: index 3 of m.v[3]; valid: -3 to
2``. As in Python, negative indices count from the end, slices are truncated to the array's length, and a division by
zero is a ZeroDivisionError.

`texts_of_exceptions` makes the exceptions of any kernel, checked or not, readable for a C program: it replaces numba's
pickles by text.
"""

from __future__ import annotations

import ctypes
import pickle
import re
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir as llvm_ir
from numba.core import cgutils, errors, ir, types
from numba.core.callconv import CPUCallConv, create_error_model
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher
from numba.core.ir_utils import compute_cfg_from_blocks, find_topo_order
from numba.core.lowering import Lower
from numba.core.typed_passes import AnnotateTypes, NativeLowering
from numba.core.untyped_passes import IRProcessing
from numba.extending import intrinsic

from cosim.deferred import compiled

__all__ = ["MOST_PASSES", "checked", "texts_of_exceptions"]

MOST_PASSES = 100_000_000
"""Maximum number of loop iterations in one call of a checked function; beyond it, the loop is considered endless."""

_INDEX_FAILED = "model_index_failed"
"""C function of fmi2.c and fmi3.c that stores the index and the length for the next message."""

_checked: dict[Dispatcher, Dispatcher] = {}
_ignored = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(lambda *_: None)
llvm.add_symbol(_INDEX_FAILED, ctypes.cast(_ignored, ctypes.c_void_p).value)  # numba links everything that it compiles


def checked(kernel: Any) -> Dispatcher:
    """Returns a checked version of the kernel, not compiled yet; the kernels that it calls are checked as well."""
    kernel = compiled(kernel)
    if kernel not in _checked:
        options = {**kernel.targetoptions, "boundscheck": True, "error_model": "python"}
        made: Any = type(kernel)(kernel.py_func, targetoptions=options, pipeline_class=_Compiler)
        made.kept_in = getattr(kernel, "kept_in", None)
        _checked[kernel] = made
    return _checked[kernel]


class _Compiler(CompilerBase):
    """numba's compiler with `_Guards` and `_Lowering`."""

    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Guards, IRProcessing)
        passes.add_pass_after(_Lowering, AnnotateTypes)
        passes.passes = [one for one in passes.passes if one[0] is not NativeLowering]
        passes.finalize()
        return [passes]


@register_pass(mutates_CFG=False, analysis_only=False)
class _Guards(FunctionPass):
    """Redirects calls to checked kernels and counts loop iterations."""

    _name = "cosim_guards"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        blocks = state.func_ir.blocks
        for block in blocks.values():
            for statement in block.find_insts(ir.Assign):
                self._use_checked(statement, state.func_ir)
        self._count_passes(blocks)
        return True

    @staticmethod
    def _use_checked(statement: Any, func_ir: Any) -> None:
        value = statement.value
        if isinstance(value, ir.Global | ir.FreeVar):
            value.value = _with_checks(value.value, value.loc)
        elif isinstance(value, ir.Expr) and value.op == "getattr":  # module.kernel
            with suppress(KeyError):
                of = func_ir.get_definition(value.value)
                module = getattr(of, "value", None) if isinstance(of, ir.Global) else None
                found = compiled(getattr(module, value.attr, None))
                if isinstance(found, Dispatcher):
                    statement.value = ir.Global(value.attr, _with_checks(found, value.loc), value.loc)

    @staticmethod
    def _count_passes(blocks: dict[int, Any]) -> None:
        cfg = compute_cfg_from_blocks(blocks)
        loops = sorted(cfg.loops().items())
        if not loops:
            return
        first = blocks[find_topo_order(blocks)[0]]
        passes = ir.Var(first.scope, "cosim_passes", first.loc)
        first.prepend(ir.Assign(ir.Const(0, first.loc), passes, first.loc))
        back = [(end, loop) for begin, loop in loops for end, _ in cfg.predecessors(begin) if end in loop.body]
        for n, (end, loop) in enumerate(sorted(back, key=lambda one: one[0])):
            block = blocks[end]
            loc = min((inst.loc for label in loop.body for inst in blocks[label].body), key=lambda at: at.line)
            count = ir.Var(block.scope, f"$cosim_count_{n}", loc)
            block.insert_before_terminator(ir.Assign(ir.Global("count_pass", _count_pass, loc), count, loc))
            call = ir.Expr.call(count, [passes], (), loc)
            block.insert_before_terminator(ir.Assign(call, passes, loc))


def _with_checks(value: Any, loc: Any) -> Any:
    if id(value) in _BY_OFFSET:
        return _BY_OFFSET[id(value)]
    if isinstance(value, Dispatcher):
        if checked(value).is_compiling:
            raise errors.UnsupportedError(f"{value.py_func.__name__} calls itself; write a loop", loc)
        return checked(value)
    if isinstance(value, tuple) and any(isinstance(item, Dispatcher) for item in value):
        return tuple(_with_checks(item, loc) for item in value)
    return value


class _Lowering(NativeLowering):
    _name = "cosim_lowering"

    @property
    def lowering_class(self) -> Any:
        return _Lower


register_pass(mutates_CFG=True, analysis_only=False)(_Lowering)


class _Lower(Lower):
    """Generates the code of a function; `now` is the instruction being generated."""

    now: Any = None

    def __init__(self, context: Any, *arguments: Any, **named: Any) -> None:
        super().__init__(context, *arguments, **named)
        self.context.__class__ = _Context  # a copy for this function
        self.context.lower = self
        self.context.error_model = create_error_model("python", self.context)  # of this convention

    def lower_inst(self, inst: Any) -> None:
        self.now = inst
        super().lower_inst(inst)


class _Context(CPUContext):
    """numba's target context with the calling convention below."""

    lower: Any

    @property
    def call_conv(self) -> Any:
        return _Convention(self)


class _Convention(CPUCallConv):
    """numba's calling convention, with the source location of every exception."""

    def return_status_propagate(self, builder: Any, status: Any) -> None:
        lower = self.context.lower
        if builder is lower.builder and (failed := _failed_within(lower)) is not None:
            self.return_user_exc(builder, *failed)
        else:
            super().return_status_propagate(builder, status)

    def set_static_user_exc(
        self, builder: Any, exc: Any, exc_args: Any = None, loc: Any = None, func_name: Any = None
    ) -> None:
        lower = self.context.lower
        if builder is not lower.builder:  # a numba-internal function, compiled once for all callers
            loc = None
        elif loc is None:
            loc, func_name = lower.loc, lower.func_ir.func_id.func_name
        super().set_static_user_exc(builder, exc, exc_args, loc, func_name)


def _failed_within(lower: _Lower) -> tuple[type[Exception], tuple[str]] | None:
    """Returns the exception for a numba function that fails in the current instruction; None in a call of a kernel."""
    inst = lower.now
    if isinstance(inst, ir.SetItem | ir.StaticSetItem):
        name, _ = _name_of(lower, inst.target)
        return ValueError, (f"{name}[...] is given an array of another length",)
    value = getattr(inst, "value", None)
    if not isinstance(value, ir.Expr) or value.op != "call":
        return (ValueError, ("an operation fails",)) if isinstance(value, ir.Expr) else None
    called = lower.typeof(value.func.name)
    if isinstance(called, types.Dispatcher):
        return None
    return ValueError, (f"{_name_of(lower, value.func)[0]}() fails",)


# ---- indices --------------------------------------------------------------------------------------------------------


class _IndexFails(IndexError):
    """An exception whose text is a printf format for the index, the length, and the least and greatest valid index."""


_do_boundscheck = cgutils.do_boundscheck


def _check_index(context: Any, builder: Any, index: Any, length: Any, axis: Any = None) -> None:
    """Generates the check of one index, which numba has converted to count from the start of the array."""
    convention = context.call_conv
    if not isinstance(convention, _Convention) or builder is not context.lower.builder:
        _do_boundscheck(context, builder, index, length, axis)
        return
    outside = builder.icmp_unsigned(">=", index, length)
    with cgutils.if_unlikely(builder, outside):
        before = builder.icmp_signed("<", index, index.type(0))
        given = builder.select(before, builder.sub(index, length), index)
        _fail_at(builder, convention, given, length, _indexed(context.lower, axis))


def _fail_at(builder: Any, convention: _Convention, index: Any, length: Any, text: str) -> None:
    int64 = llvm_ir.IntType(64)
    failed = cgutils.get_or_insert_function(
        builder.module, llvm_ir.FunctionType(llvm_ir.VoidType(), [int64, int64]), _INDEX_FAILED
    )
    builder.call(failed, [index, length])
    convention.return_user_exc(builder, _IndexFails, (text,))


cgutils.do_boundscheck = _check_index


def _indexed(lower: _Lower, axis: Any) -> str:
    """Returns the format of the message for an index outside the array in the current instruction."""
    inst = lower.now
    indexed = inst.target if isinstance(inst, ir.SetItem | ir.StaticSetItem) else getattr(inst.value, "value", None)
    name, shape = _name_of(lower, indexed)
    dimensions = lower.fndesc.typemap[indexed.name].ndim if isinstance(indexed, ir.Var) else 1
    if axis is None or dimensions == 1:
        return f"index %lld of {name}[%lld]; valid: %lld to %lld"
    sizes = ", ".join("%lld" if i == axis else str(n) for i, n in enumerate(shape or [":"] * dimensions))
    return f"index %lld in dimension {axis + 1} of {name}[{sizes}]; valid: %lld to %lld"


def _name_of(lower: _Lower, value: Any) -> tuple[str, tuple[int, ...] | None]:
    """Returns the name of an array in the author's source, and its shape if the declaration determines it."""
    if not isinstance(value, ir.Var):
        return "an array", None
    try:
        definition = lower.func_ir.get_definition(value)
    except KeyError:
        definition = None
    if isinstance(definition, ir.Expr) and definition.op == "getattr":
        of = lower.fndesc.typemap.get(definition.value.name)
        if isinstance(of, types.Record) and definition.attr in of.fields:
            field = of.typeof(definition.attr)
            record, _ = _name_of(lower, definition.value)
            return f"{record}.{definition.attr}", getattr(field, "shape", None)
        return f"{_name_of(lower, definition.value)[0]}.{definition.attr}", None
    if isinstance(definition, ir.Global | ir.FreeVar | ir.Arg):
        return str(definition.name), None
    if not value.name.startswith("$"):
        return str(value.unversioned_name), None
    if isinstance(definition, ir.Var):
        return _name_of(lower, definition)
    if isinstance(definition, ir.Expr) and definition.op in ("getitem", "static_getitem"):
        return f"{_name_of(lower, definition.value)[0]}[...]", None
    return "an array", None


# ---- loops and fields by offset -------------------------------------------------------------------------------------


@intrinsic
def _count_pass(typing: Any, passes: Any) -> Any:  # noqa: ARG001 (numba prescribes the arguments)
    def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        count = builder.add(arguments[0], arguments[0].type(1))
        with cgutils.if_unlikely(builder, builder.icmp_signed(">", count, count.type(MOST_PASSES))):
            text = f"the loop has not ended after {MOST_PASSES} passes"
            context.call_conv.return_user_exc(builder, RuntimeError, (text,))
        return count

    return types.int64(types.int64), lower


def _within(unchecked: Any, size: int) -> Any:
    """Returns the intrinsic that reads or writes a record's field by offset, with a check of the offset."""

    def check(typing: Any, record: Any, offset: Any, *value: Any) -> Any:
        signature, write = unchecked._defn(typing, record, offset, *value)

        def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            end = arguments[1].type(record.size - size + 1)
            with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", arguments[1], end)):
                text = "offset %lld of a record with fields at offsets below %lld"
                _fail_at(builder, context.call_conv, arguments[1], end, text)
            return write(context, builder, signature, arguments)

        return signature, lower

    if unchecked._defn.__code__.co_argcount == 4:
        return intrinsic(lambda typing, record, offset, value: check(typing, record, offset, value))
    return intrinsic(lambda typing, record, offset: check(typing, record, offset))


_fields: Any = import_module("cosim.fields")
_BY_OFFSET = {
    id(compiled(getattr(_fields, name))): _within(compiled(getattr(_fields, f"_{name}")), size)
    for name, size in (("get_real", 8), ("set_real", 8), ("get_whole", 4), ("set_whole", 4))
    if hasattr(compiled(getattr(_fields, f"_{name}")), "_defn")
}
"""Kernels that read and write by offset -> their checked versions; errors give the line of the call."""


# ---- messages for a C program ---------------------------------------------------------------------------------------

_PICKLE = re.compile(r'^(@"?\.const\.pickledata\.[0-9a-f]+(?:\.\d+)?"? = .*)\[\d+ x i8\] c"([^"]*)"', re.MULTILINE)


def texts_of_exceptions(ir: str) -> str:
    """Returns the LLVM IR of kernels with each exception's pickle replaced by its text as a printf format."""

    def text(pickled: re.Match[str]) -> str:
        declared, data = pickled.groups()
        content = re.sub(rb"\\(\\|[0-9A-Fa-f]{2})", _byte, data.encode("latin-1"))
        told = pickle.loads(content)  # written by numba in this process
        if not isinstance(told, tuple) or len(told) != 3:
            return pickled[0]
        shown = _told(*told).encode() + b"\0"
        escaped = "".join(chr(b) if 32 <= b < 127 and b not in b'"\\' else f"\\{b:02X}" for b in shown)
        return f'{declared}[{len(shown)} x i8] c"{escaped}"'

    return _PICKLE.sub(text, ir)


def _byte(code: re.Match[bytes]) -> bytes:
    """Decodes one byte of a string in LLVM IR: a backslash and two hexadecimal digits, or two backslashes."""
    return b"\\" if code[1] == b"\\" else bytes([int(code[1], 16)])


def _told(of: type[BaseException] | None, arguments: tuple[Any, ...], place: tuple[str, str, int] | None) -> str:
    where = "" if place is None or "numba" in Path(place[1]).parts else f"{shown_file(place[1])}:{place[2]}: "
    if of is _IndexFails:
        return f"{where}{arguments[0]}".replace("%lld", "\0").replace("%", "%%").replace("\0", "%lld")
    what = "an exception" if of is None else of.__name__
    said = ", ".join(map(str, arguments))
    return f"{where}{what}{': ' if said else ''}{said}".replace("%", "%%")


def shown_file(name: str) -> str:
    """Returns the path of a source file from its outermost package on, independent of its location on disk."""
    file = root = Path(name)
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    return file.relative_to(root.parent).as_posix()
