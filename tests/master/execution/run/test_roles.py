"""Roles of the arrays of a run: none is forgotten, and what is saved follows from them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from cosim_master.execution.run.state import changing
from cosim_master.network.radio.tables import ROLES as RADIO_ROLES
from cosim_master.network.radio.tables import Radio
from cosim_master.network.roles import BUFFER, CONSTANT, PASSING, STATE, declared
from cosim_master.stepping.kernels import tables
from cosim_master.stepping.kernels.tables import ROLES, Plan

DTYPES = {"instances": tables.INSTANCE, "ports": tables.PORTS, "slopes": tables.SLOPE}
"""Tables of the plan whose columns have roles of their own."""


def test_every_array_and_column_has_a_role_and_nothing_else_has() -> None:
    columns = {f"{name}.{column}" for name, dtype in DTYPES.items() for column in dtype.names or ()}
    assert {*ROLES} == ({*Plan._fields} - {*DTYPES}) | columns
    assert {*RADIO_ROLES} == {*Radio._fields}
    assert {*ROLES.values()} == {*RADIO_ROLES.values()} == {CONSTANT, STATE, PASSING, BUFFER}


class Small(NamedTuple):
    values: Any
    rows: Any


def small(*columns: str) -> Any:
    return Small(np.zeros(2), np.zeros(3, dtype=[(name, "f8") for name in columns]))


def test_the_arrays_with_a_role_are_views() -> None:
    roles = declared(CONSTANT="rows.length", STATE="values rows.speed")
    arrays = small("length", "speed")
    found = changing(arrays, roles, (STATE,))
    assert [*found] == ["values", "rows.speed"]
    found["rows.speed"][:] = 7.0
    assert arrays.rows["speed"].tolist() == [7.0, 7.0, 7.0]


def test_a_column_that_was_added_without_a_role_is_an_error() -> None:
    roles = declared(CONSTANT="rows.length", STATE="values rows.speed")
    with pytest.raises(KeyError, match=r"rows\.added"):
        changing(small("length", "speed", "added"), roles, (STATE,))


def test_a_role_that_is_declared_twice_is_an_error() -> None:
    with pytest.raises(AssertionError, match="a role is declared twice"):
        declared(CONSTANT="values", STATE="values")
