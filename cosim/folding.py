"""LLVM IR without what LLVM would remove first: less of it is written, printed, read and optimised.

numba describes each array by a structure of seven words in memory, which it fills and reads again for every element:
85 instructions for ``m.v[i]``, of which LLVM leaves five. It looks for a ``try`` at every call. `use` replaces these: a
structure stays a value where a block makes and reads it, and what is known of constants is computed at once. `sweep`
then removes instructions and memory that nobody reads. What a function computes remains the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache, wraps
from inspect import unwrap
from typing import Any

from llvmlite import ir as llvm_ir
from llvmlite.ir import instructions
from numba.core import cgutils, ir, lowering
from numba.core.callconv import CPUCallConv
from numba.core.types import Array
from numba.core.unsafe import eh
from numba.np import arrayobj

__all__ = ["sweep", "use"]


# ---- constants and parts of values -----------------------------------------------------------------------------------

_Builder: Any = llvm_ir.IRBuilder


def _own(name: str) -> Any:
    """Returns llvmlite's method, some of which wrap others, also in a second copy of this module."""
    file = _Builder.load.__code__.co_filename
    return unwrap(getattr(_Builder, name), stop=lambda one: one.__code__.co_filename == file)


_extract_value, _insert_value = _own("extract_value"), _own("insert_value")


def _element(constant: Any, index: int) -> Any:
    """Returns an element of a constant structure or array."""
    kind, content = constant.type.elements[index], constant.constant
    return content[index] if isinstance(content, list | tuple) else llvm_ir.Constant(kind, content)


def _is_plain(value: Any) -> bool:
    return type(value) is llvm_ir.Constant and (
        value.constant is None or value.constant is llvm_ir.Undefined or isinstance(value.constant, list | tuple)
    )


@wraps(_extract_value)
def _extract(self: Any, agg: Any, idx: Any, name: str = "") -> Any:
    """Returns a member of an aggregate: the value that was inserted there, if it is known."""
    index = idx[0] if isinstance(idx, list | tuple) and len(idx) == 1 else idx
    if not isinstance(index, int):
        return _extract_value(self, agg, idx, name)
    while type(agg) is instructions.InsertValue and len(agg.indices) == 1:
        if agg.indices[0] == index:
            return agg.value
        agg = agg.aggregate
    return _element(agg, index) if _is_plain(agg) else _extract_value(self, agg, index, name)


@wraps(_insert_value)
def _insert(self: Any, agg: Any, value: Any, idx: Any, name: str = "") -> Any:
    """Inserts a member into an aggregate; a constant into a constant gives a constant."""
    index = idx[0] if isinstance(idx, list | tuple) and len(idx) == 1 else idx
    if isinstance(index, int) and _is_plain(agg) and type(value) is llvm_ir.Constant:
        elements = [_element(agg, i) for i in range(len(agg.type.elements))]
        if 0 <= index < len(elements) and elements[index].type == value.type:
            elements[index] = value
            return llvm_ir.Constant(agg.type, elements)
    return _insert_value(self, agg, value, idx, name)


def _number(value: Any) -> int | None:
    """Returns the number of a constant integer as a signed one: unsigned constants have the same bits."""
    if type(value) is llvm_ir.Constant and isinstance(value.type, llvm_ir.IntType) and type(value.constant) is int:
        return _signed(value.constant, value.type.width)
    return None


def _signed(number: int, width: int) -> int:
    half = 1 << (width - 1)
    return (number + half) % (2 * half) - half


def _wrapped(number: int, kind: Any) -> Any:
    return llvm_ir.Constant(kind, _signed(number, kind.width))


_add, _mul, _icmp, _select = _own("add"), _own("mul"), _own("icmp_signed"), _own("select")
_COMPARED = {"<": int.__lt__, "<=": int.__le__, ">": int.__gt__, ">=": int.__ge__, "==": int.__eq__, "!=": int.__ne__}


@wraps(_add)
def _sum(self: Any, lhs: Any, rhs: Any, name: str = "", flags: Any = ()) -> Any:
    one, other = _number(lhs), _number(rhs)
    if one is not None and other is not None and lhs.type == rhs.type and lhs.type.width > 1:
        return _wrapped(one + other, lhs.type)
    if one == 0 and lhs.type == rhs.type:
        return rhs
    if other == 0 and lhs.type == rhs.type:
        return lhs
    return _add(self, lhs, rhs, name, flags)


@wraps(_mul)
def _product(self: Any, lhs: Any, rhs: Any, name: str = "", flags: Any = ()) -> Any:
    one, other = _number(lhs), _number(rhs)
    if one is not None and other is not None and lhs.type == rhs.type and lhs.type.width > 1:
        return _wrapped(one * other, lhs.type)
    if one == 1 and lhs.type == rhs.type and lhs.type.width > 1:
        return rhs
    if other == 1 and lhs.type == rhs.type and lhs.type.width > 1:
        return lhs
    return _mul(self, lhs, rhs, name, flags)


@wraps(_icmp)
def _compared(self: Any, cmpop: str, lhs: Any, rhs: Any, name: str = "") -> Any:
    one, other = _number(lhs), _number(rhs)
    if one is not None and other is not None and lhs.type == rhs.type and lhs.type.width > 1:
        return llvm_ir.Constant(llvm_ir.IntType(1), int(_COMPARED[cmpop](one, other)))
    return _icmp(self, cmpop, lhs, rhs, name)


@wraps(_select)
def _selected(self: Any, cond: Any, lhs: Any, rhs: Any, name: str = "", flags: Any = ()) -> Any:
    known = _number(cond)
    return _select(self, cond, lhs, rhs, name, flags) if known is None else lhs if known else rhs


# ---- structures ------------------------------------------------------------------------------------------------------

_Proxy: Any = cgutils._StructProxy
_begin, _get, _set = (unwrap(getattr(_Proxy, name)) for name in ("__init__", "__getitem__", "__setitem__"))
_whole, _attribute = unwrap(_Proxy._getvalue), unwrap(_Proxy.__getattr__)


@wraps(_begin)
def _begin_as_value(self: Any, context: Any, builder: Any, value: Any = None, ref: Any = None) -> None:
    """Begins a structure as the value `_now`, of which the current block makes another one by each assignment.

    It goes to memory when its address is asked for, or when another block uses it, because blocks may be entered on
    several ways, and again and again. An array with a value is only read; other blocks, too, take members of the value.
    """
    wrapped = not isinstance(self, cgutils.ValueStructProxy) or context._defns["__array__"].versions
    if ref is not None or wrapped:
        _begin(self, context, builder, value, ref)
        return
    self._context, self._builder = context, builder
    self._datamodel = context.data_model_manager[self._fe_type]
    self._be_type = self._get_be_type(self._datamodel)
    if value is not None and value.type != self._be_type:
        raise AssertionError(f"bad value type: expected {self._be_type}, got {value.type}")
    self._now = llvm_ir.Constant(self._be_type, None) if value is None else value
    self._block = builder.block
    self._only_read = value is not None and isinstance(self._fe_type, Array)
    self._read_elsewhere = False


def _is_value(self: Any, *, read: bool) -> bool:
    """Returns whether a structure is a value here; `read`: it will not be changed."""
    if "_now" not in self.__dict__:
        return False
    if self._builder.block is self._block:
        return True
    if read and self._only_read:
        self._read_elsewhere = True
        return True
    return False


@wraps(_attribute)
def _attribute_or_memory(self: Any, name: str) -> Any:
    """Returns a member; the address of a structure puts it into memory, at the end of the block that made it."""
    if name not in ("_value", "_outer_ref") or "_now" not in self.__dict__:
        return _attribute(self, name)
    builder, now, block = self._builder, self.__dict__.pop("_now"), self._block
    memory = cgutils.alloca_once(builder, self._be_type)
    self._value = self._outer_ref = memory
    if builder.block is block:
        builder.store(now, memory)
        return memory
    place = builder._block, builder._anchor
    if block.terminator is None:
        builder.position_at_end(block)
    else:
        builder.position_before(block.terminator)
    builder.store(now, memory)
    builder._block, builder._anchor = place
    return memory


@wraps(_get)
def _get_member(self: Any, index: int) -> Any:
    return self._builder.extract_value(self._now, index) if _is_value(self, read=True) else _get(self, index)


@wraps(_set)
def _set_member(self: Any, index: int, value: Any) -> None:
    if _is_value(self, read=False) and value.type == self._be_type.elements[index]:
        self._now = self._builder.insert_value(self._now, value, index)
        return
    assert not self.__dict__.get("_read_elsewhere"), f"a member of {self._fe_type} is set after it was read"
    _set(self, index, value)


@wraps(_whole)
def _whole_value(self: Any) -> Any:
    return self._now if _is_value(self, read=True) else _whole(self)


_make_array: Any = unwrap(arrayobj.make_array)


@cache
def _array_of(array_type: Any) -> Any:
    """Returns the class of arrays of a type, which numba makes for each access to one."""
    made = _make_array(array_type)
    from_memory = made.shape.fget

    def shape(self: Any) -> Any:
        return self[self._datamodel.get_field_position("shape")] if _is_value(self, read=True) else from_memory(self)

    made.shape = property(shape)
    return made


# ---- variables and calls ---------------------------------------------------------------------------------------------

_arguments: Any = unwrap(lowering.Lower.extract_function_arguments)
_propagate: Any = unwrap(CPUCallConv.return_status_propagate)


@wraps(_arguments)
def _begin_function(self: Any) -> Any:
    """Notes whether a function has a `try`, and takes its arguments."""
    values = (one.value for block in self.blocks.values() for one in block.find_insts(ir.Assign))
    self.builder.has_try = any(isinstance(one, ir.Global) and one.value is eh.mark_try_block for one in values)
    return _arguments(self)


@wraps(_propagate)
def _pass_on(self: Any, builder: Any, status: Any) -> None:
    """Returns the status of a call that failed; a function without `try` does not look whether it is in one."""
    if getattr(builder, "has_try", True):
        _propagate(self, builder, status)
        return
    builder.store(status.excinfoptr, self._get_excinfo_argument(builder.function))
    builder.ret(status.code)


# ---- what nobody reads -----------------------------------------------------------------------------------------------

_PURE = {
    *("alloca", "load", "getelementptr", "extractvalue", "insertvalue", "select", "phi", "icmp", "fcmp"),
    *("add", "sub", "mul", "and", "or", "xor", "shl", "lshr", "ashr", "fadd", "fsub", "fmul", "fdiv", "fneg"),
    *("bitcast", "addrspacecast", "ptrtoint", "inttoptr", "zext", "sext", "trunc"),
    *("sitofp", "uitofp", "fptosi", "fptoui", "fpext", "fptrunc"),
}


def sweep(module: Any) -> None:
    """Removes instructions whose results nobody uses, and memory that nobody reads, from the functions of a module."""
    for function in module.functions:
        _sweep(function)


def _operands(instruction: Any) -> Iterable[Any]:
    if isinstance(instruction, instructions.PhiInstr):
        return [value for value, _ in instruction.incomings]
    return instruction.operands  # type: ignore[no-any-return]


def _sweep(function: Any) -> None:
    users: dict[Any, list[Any]] = {}
    known: dict[int, Any] = {}
    for block in function.blocks:
        for one in block.instructions:
            known[id(one)] = one
    for one in known.values():
        for operand in _operands(one):
            if id(operand) in known:
                users.setdefault(id(operand), []).append(one)
    dead: set[int] = set()

    def unused(one: Any) -> bool:
        return all(id(user) in dead for user in users.get(id(one), ()))

    def unread(memory: Any) -> list[Any] | None:
        """Returns what writes to memory, and all of its addresses; None if somebody reads it."""
        found = []
        for user in users.get(id(memory), ()):
            if id(user) in dead:
                continue
            if user.opname == "store" and user.operands[0] is not memory:
                found.append(user)
            elif user.opname in ("getelementptr", "bitcast") and (beyond := unread(user)) is not None:
                found += [user, *beyond]
            else:
                return None
        return found

    waiting = list(known.values())
    memories = [one for one in waiting if one.opname == "alloca"]
    while waiting:
        while waiting:
            one = waiting.pop()
            if id(one) not in dead and one.opname in _PURE and unused(one):
                dead.add(id(one))
                waiting += [known[id(operand)] for operand in _operands(one) if id(operand) in known]
        for memory in memories:
            if id(memory) not in dead and (written := unread(memory)) is not None:
                gone = [memory, *written]
                dead.update(map(id, gone))
                waiting += [known[id(o)] for one in gone for o in _operands(one) if id(o) in known]
    for block in function.blocks:
        block.instructions[:] = [one for one in block.instructions if id(one) not in dead]


def use() -> None:
    """Replaces methods of llvmlite and numba by those of this module, for all that this process compiles."""
    for name, method in (
        ("extract_value", _extract),
        ("insert_value", _insert),
        ("add", _sum),
        ("mul", _product),
        ("icmp_signed", _compared),
        ("select", _selected),
    ):
        setattr(_Builder, name, method)
    _Proxy.__init__, _Proxy.__getattr__ = _begin_as_value, _attribute_or_memory
    _Proxy.__getitem__, _Proxy.__setitem__, _Proxy._getvalue = _get_member, _set_member, _whole_value
    arrayobj.make_array = _array_of
    setattr(lowering.Lower, "extract_function_arguments", _begin_function)  # noqa: B010 (numba is typed in part)
    setattr(CPUCallConv, "return_status_propagate", _pass_on)  # noqa: B010
