"""The codes by which a call of the stepping loop converts values: `width` of a CALL row (see `tables`).

They are apart from the kernels that use them, so that the checks of a system do not import numba.
"""

from __future__ import annotations

__all__ = ["PACKED", "WIDE_WIDTHS", "WIDTHS"]

WIDTHS = {
    "Float64": 1,
    "Int32": 1,
    "Binary": 2,
    "Float32": 3,
    "Int8": 4,
    "UInt8": 5,
    "Int16": 6,
    "UInt16": 7,
    "UInt32": 8,
    "Int64": 9,
    "UInt64": 10,
    "Boolean": 11,
}
"""By FMI 3 type; 0 is FMI 2. Values of width 1 are the plan's own."""
WIDE_WIDTHS = {"Int64": 12, "UInt64": 12, "UInt32": 13}
"""The same for types whose values have two places in the plan."""
PACKED = 14
"""For values that are the plan's own, if there are less than 65536 references and values: `values` of the row is the
address of the values, and `n` contains both numbers, that of values in the upper half.
"""
