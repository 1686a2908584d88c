"""The digests of a run's inputs: that of start values is made from their texts, which many instances share."""

from __future__ import annotations

import hashlib
from typing import Any

from cosim_master.execution.preparation.fingerprint import fingerprint_of
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system


def test_start_values_are_those_of_each_instance_sorted_by_name(workshop: Any, variable: Any) -> None:
    workshop.fmu(
        "unit.fmu",
        variable("z", start="-0.0"),
        variable("k's", "parameter", start="1e300"),
        variable("i", "parameter", kind="Integer", start="3"),
        variable("label", "parameter", kind="String", start='a"b'),
        variable("b.free", "local", initial="approx", start="4"),  # set only where the system does
        variable("y", "output"),
        step="0.01",
    )
    workshop.fmu("other.fmu", variable("p", "parameter", start="2.5"), step="0.01")
    elements = "".join(workshop.component(name, "unit.fmu") for name in ("a1'", "a2")) + "".join(
        workshop.component(name, "other.fmu") for name in ("b1", "b2")
    )
    values = {"a2.b.free": 4.0, "a2.i": 7, "a2.z": 1.0, "b2.p": 2.5}
    file = workshop.ssd("s.ssd", workshop.system(elements, bindings=workshop.bindings(values)))
    ready = prepare(check(read_system(file)), until=1.0)
    found = fingerprint_of(ready.checked, ready.clock, ready.network, ready.master, system="")

    instances = ready.checked.instances
    effective = [(one.name, sorted(one.effective_values().items())) for one in instances]
    given = [(one.name, sorted(one.start_values.items())) for one in instances]
    assert effective[0][1][0] == ("i", 3) and effective[1][1][0] == ("b.free", 4.0)
    whole = "".join(f"{one!r}\n" for one in (*effective, *given))
    assert found["start values"] == hashlib.sha256(whole.encode()).hexdigest()[:16]
