"""Folded LLVM IR: functions compute the same as numba's own, from less of it."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

numba = pytest.importorskip("numba")

import llvmlite.binding as llvm  # noqa: E402
from llvmlite import ir as llvm_ir  # noqa: E402
from numba import types  # noqa: E402
from numba.core import cgutils  # noqa: E402
from numba.core.registry import cpu_target  # noqa: E402

from cosim import folding  # noqa: E402
from cosim.kernel import kernel  # noqa: E402

pytestmark = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")

LONG, BIT = llvm_ir.IntType(64), llvm_ir.IntType(1)
RECORD = np.dtype([("v", "f8", (3,)), ("w", "f8", (4, 2)), ("n", "i4", (5,))], align=True)


def function(result: Any = LONG, *of: Any) -> tuple[llvm_ir.IRBuilder, Any]:
    module = llvm_ir.Module()
    made = llvm_ir.Function(module, llvm_ir.FunctionType(result, of), "f")
    return llvm_ir.IRBuilder(made.append_basic_block()), made


def opnames(made: Any) -> list[str]:
    return [one.opname for block in made.blocks for one in block.instructions]


@pytest.mark.parametrize("lhs", [-(2**63), -7, -1, 0, 1, 2, 2**63 - 1])
@pytest.mark.parametrize("rhs", [-(2**63), -1, 0, 1, 3, 2**63 - 1])
def test_constants_are_computed_as_the_processor_computes_them(lhs: int, rhs: int) -> None:
    builder, made = function()
    a, b = LONG(lhs), LONG(rhs)
    with np.errstate(over="ignore"):
        one, other = np.int64(lhs), np.int64(rhs)
        assert builder.add(a, b).constant == one + other
        assert builder.mul(a, b).constant == one * other
    for word, expected in (
        ("<", lhs < rhs),
        ("<=", lhs <= rhs),
        (">", lhs > rhs),
        (">=", lhs >= rhs),
        ("==", lhs == rhs),
        ("!=", lhs != rhs),
    ):
        assert builder.icmp_signed(word, a, b).constant == expected
    assert builder.select(BIT(1), a, b) is a
    assert builder.select(BIT(0), a, b) is b
    assert opnames(made) == []


def test_a_constant_may_be_written_unsigned() -> None:
    builder, _ = function()
    assert builder.icmp_signed("<", LONG(2**64 - 1), LONG(0)).constant == 1
    assert builder.icmp_signed("==", LONG(2**64 - 2), LONG(-2)).constant == 1
    assert builder.add(LONG(2**64 - 1), LONG(1)).constant == 0


def test_neutral_elements_leave_the_value() -> None:
    builder, made = function(LONG, LONG)
    (x,) = made.args
    assert builder.add(x, LONG(0)) is x is builder.add(LONG(0), x)
    assert builder.mul(x, LONG(1)) is x is builder.mul(LONG(1), x)
    assert builder.mul(x, LONG(0)) is not x is not builder.add(x, LONG(1))
    assert opnames(made) == ["mul", "add"]
    with pytest.raises(ValueError, match="same type"):
        builder.add(x, llvm_ir.IntType(32)(0))


def test_members_are_those_that_were_inserted() -> None:
    pair = llvm_ir.LiteralStructType([LONG, LONG])
    builder, made = function(LONG, LONG, pair)
    x, given = made.args
    both = builder.insert_value(builder.insert_value(pair(llvm_ir.Undefined), x, 0), LONG(3), 1)
    assert builder.extract_value(both, 0) is x
    assert builder.extract_value(both, 1).constant == 3
    assert builder.extract_value(builder.insert_value(given, x, 1), 0).operands == [given]
    assert builder.extract_value(pair(None), 1).constant == 0
    constant = builder.insert_value(pair(None), LONG(4), 1)
    assert str(constant) == "{i64, i64} {i64 0, i64 4}"


def test_a_structure_is_a_value_in_its_block_and_memory_in_others() -> None:
    builder, made = function(LONG, LONG, BIT)
    _, again = made.args
    context = cpu_target.target_context
    pair = cgutils.create_struct_proxy(types.complex128)(context, builder)
    pair.real = llvm_ir.DoubleType()(2.0)
    assert pair.real.constant == 2.0
    assert opnames(made) == []
    loop, after = builder.append_basic_block(), builder.append_basic_block()
    builder.branch(loop)
    builder.position_at_end(loop)
    before = pair.real
    pair.real = builder.fadd(before, before)
    builder.cbranch(again, loop, after)
    builder.position_at_end(after)
    builder.ret(builder.fptosi(pair.real, LONG))
    assert before.opname == "load"  # by the second turn, it is what the first has set
    first = [one.opname for one in made.blocks[0].instructions]
    assert first[-2:] == ["store", "br"] and "alloca" in first
    llvm.parse_assembly(str(made.module)).verify()


def test_what_nobody_reads_is_removed_and_what_somebody_reads_stays() -> None:
    builder, made = function(LONG, LONG)
    (x,) = made.args
    unread, read = builder.alloca(LONG), builder.alloca(LONG)
    builder.store(builder.mul(x, LONG(5)), unread)
    builder.store(builder.mul(x, LONG(7)), read)
    builder.add(builder.load(unread), LONG(1))
    held = builder.alloca(LONG.as_pointer())
    builder.store(read, held)  # its address is kept in memory that nobody reads
    builder.ret(builder.load(read))
    folding.sweep(made.module)
    assert opnames(made) == ["alloca", "mul", "store", "load", "ret"]
    llvm.parse_assembly(str(made.module)).verify()


def test_memory_whose_address_goes_elsewhere_stays() -> None:
    builder, made = function(LONG, LONG.as_pointer().as_pointer())
    memory = builder.alloca(LONG)
    builder.store(LONG(5), memory)
    builder.store(memory, made.args[0])
    builder.ret(LONG(0))
    folding.sweep(made.module)
    assert opnames(made) == ["alloca", "store", "store", "ret"]


@kernel
def _of_record(m: Any, i: int, k: int) -> float:
    total = 0.0
    for j in range(i):
        m.v[j - 1] = total + m.w[j, k]
        row = m.w[j]
        if m.v[j - 1] > 2.0:
            row[k] = -m.v[-1]
        total += row[0] + len(m.n) + m.n[j]
    m.v[1:] = m.v[:2]
    for one in m.v:
        total = 2.0 * total + one
    return total


@pytest.mark.parametrize(("i", "k"), [(0, 0), (1, -1), (3, 0), (3, 1)])
def test_a_kernel_with_arrays_computes_what_python_computes(i: int, k: int) -> None:
    compiled, plain = np.zeros(1, RECORD).view(np.recarray), np.zeros(1, RECORD).view(np.recarray)
    for one in (compiled, plain):
        one["w"] = np.arange(8.0).reshape(4, 2) - 1.5
        one["n"] = np.arange(5) * 3
    function: Any = _of_record
    assert function(compiled[0], i, k) == function.py_func(plain[0], i, k)
    assert compiled.tobytes() == plain.tobytes()


def test_the_element_of_an_array_takes_few_instructions() -> None:
    @kernel
    def element(m: Any, i: int) -> float:
        return float(m.v[i])

    lowered: Any = element
    text = str(lowered.lower((numba.from_dtype(RECORD), types.int64)).library._final_module)
    body = text.partition("define ")[2].partition("\n}")[0].splitlines()
    assert len(body) < 30, text  # numba's own has 90
