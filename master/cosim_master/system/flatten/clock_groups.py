"""Groups of instances that Clocks connect (FMI 3.0.2, sections 2.2.8, 2.3)."""

from __future__ import annotations

from cosim_master.system.flatten.flat import CheckedSystem

__all__ = ["lockstep"]


def lockstep(checked: CheckedSystem) -> tuple[tuple[int, ...], ...]:
    """Returns groups of at least two instances that are connected by Clocks or by variables that belong to Clocks.

    Instances are given by number. Their events are simultaneous, so they step together to the next tick or event of any
    of them.
    """
    number = {one.name: i for i, one in enumerate(checked.instances)}
    fmus = {id(one.fmu): one.fmu for one in checked.instances}
    with_clocks = {key for key, fmu in fmus.items() if any(v.clock for v in fmu.variables.values())}
    clocked = {i for i, one in enumerate(checked.instances) if id(one.fmu) in with_clocks}
    if not clocked:
        return ()
    group = {i: {i} for i in clocked}
    for link in checked.links:
        source, target = number[link.source[0]], number[link.target[0]]
        ends = (
            checked.instances[source].fmu.variables[link.source[1]],
            checked.instances[target].fmu.variables[link.target[1]],
        )
        tied = any(v.clock is not None or v.clocks for v in ends)
        if tied and source in clocked and target in clocked and group[source] is not group[target]:
            joined = group[source] | group[target]
            group.update(dict.fromkeys(joined, joined))
    return tuple(sorted({tuple(sorted(members)) for members in group.values() if len(members) > 1}))
