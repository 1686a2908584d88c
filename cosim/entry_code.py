"""Machine code of kernels that Python calls by their address (`cosim.entry`), made by numba and LLVM."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir as llvm_ir
from numba import typeof
from numba.core import cgutils, event, types
from numba.core.compiler_lock import global_compiler_lock

from cosim.lowering import Kernel, Library, keep_only, link, without_collector

__all__ = ["entry_code"]


def entry_code(kernel: Kernel, arguments: Sequence[Any], symbol: str) -> tuple[str, bytes, bool]:
    """Returns machine code of a kernel for calls without numba, for arguments of the types that `arguments` have.

    The code defines ``int32 symbol(int64 *result, int64 *words)``. Of each argument there is one word: an integer, or
    the address of further words, which are those of the members of a tuple, one after the other, and of an array the
    address of its data, its shape and its strides. The function returns 0, or another value if the kernel raised an
    exception.

    Returns:
        the kind of the result: ``"int"``, ``"bool"`` or ``"none"``; the code; and whether another process may use it.

    Raises:
        TypeError: an argument or the result is of another type.
        RuntimeError: the code needs a function that this process does not have.
    """
    of = tuple(map(typeof, arguments))
    with global_compiler_lock, without_collector(), event.trigger_event("numba:compile", {"dispatcher": kernel}):
        lowered, context = kernel.lower(of), kernel.targetctx
        returns = lowered.signature.return_type
        kind = _kind_of_result(returns)
        context.refresh()  # numba's declarations, which reading a lowered kernel does not load
        codegen = context.codegen()
        module = codegen._create_empty_module(symbol)
        word, number = llvm_ir.IntType(64), llvm_ir.IntType(32)
        function = llvm_ir.Function(module, llvm_ir.FunctionType(number, [word.as_pointer()] * 2), symbol)
        builder = llvm_ir.IRBuilder(function.append_basic_block("entry"))
        result, words = function.args
        values = [_argument(context, builder, one, words, place) for place, one in enumerate(of)]
        callee = context.declare_function(module, lowered.result.fndesc)
        status, value = context.call_conv.call_function(builder, callee, returns, of, values)
        if kind != "none":
            value = context.cast(builder, value, returns, types.int64)
            builder.store(value, result)
        builder.ret(builder.select(status.is_error, number(1), number(0)))
        library = Library(codegen, symbol)
        library.add_ir_module(module)
        library.add_linking_library(lowered.library)
        linked = link([library])
        keep_only(linked, [symbol])
        for variable in linked.global_variables:
            if not variable.is_declaration:
                variable.linkage = "internal"
        passes, pass_builder = codegen._module_pass_manager()
        passes.run(linked, pass_builder)
        linked.verify()
        needs = (one.name for one in linked.functions if one.is_declaration and not one.name.startswith("llvm."))
        if missing := [name for name in needs if llvm.address_of_symbol(name) is None]:
            raise RuntimeError(f"{kernel.py_func.__qualname__} needs {', '.join(missing)}, which this process has not")
        settled = not any(variable.name.startswith(".dynamic.globals") for variable in linked.global_variables)
        return kind, bytes(codegen._tm.emit_object(linked)), settled


def _kind_of_result(returns: Any) -> str:
    if isinstance(returns, types.Boolean):
        return "bool"
    if isinstance(returns, types.Integer):
        return "int"
    if isinstance(returns, types.NoneType):
        return "none"
    raise TypeError(f"a kernel called by address returns an integer, a bool or nothing, not {returns}")


def _argument(context: Any, builder: Any, kind: Any, words: Any, place: int) -> Any:
    """Generates the value of an argument from its word."""
    word = builder.load(builder.gep(words, [llvm_ir.IntType(64)(place)]))
    if isinstance(kind, types.Integer) and kind.bitwidth == 64:
        return word
    further = builder.inttoptr(word, words.type)
    return _from_words(context, builder, kind, further, count())


def _from_words(context: Any, builder: Any, kind: Any, words: Any, places: Iterator[int]) -> Any:
    """Generates a tuple, an array or an integer from the words from the next of `places` on."""

    def following(n: int) -> list[Any]:
        return [builder.load(builder.gep(words, [llvm_ir.IntType(64)(next(places))])) for _ in range(n)]

    if isinstance(kind, types.BaseTuple):
        return context.make_tuple(builder, kind, [_from_words(context, builder, one, words, places) for one in kind])
    if isinstance(kind, types.Integer) and kind.bitwidth == 64:
        return following(1)[0]
    if not isinstance(kind, types.Array):
        raise TypeError(f"a kernel called by address receives integers, arrays and tuples of these, not {kind}")
    made = context.make_array(kind)(context, builder)
    [data], shape, strides = following(1), following(kind.ndim), following(kind.ndim)
    size = context.get_constant(types.intp, 1)
    for length in shape:
        size = builder.mul(size, length)
    made.data = builder.inttoptr(data, made.data.type)
    made.shape, made.strides = cgutils.pack_array(builder, shape), cgutils.pack_array(builder, strides)
    made.itemsize = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    made.nitems = size
    made.meminfo = made.parent = cgutils.get_null_value(made.meminfo.type)
    return made._getvalue()
