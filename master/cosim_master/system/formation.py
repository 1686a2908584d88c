"""Consequences of the law that agents declare (`cosim.verdict.Formation`): final positions and convergence.

In each step, a mobile agent adds the sum of its terms to its position; a term is gain times (position of the neighbour
- own position): x(k+1) = x(k) - G x(k). Row i of G has the sum of the gains of agent i in column i, and minus the gain
for each neighbour in the neighbour's column; the rows of stationary agents are zero. If all gains are equal, G is the
gain times the Laplacian of the graph.

The arithmetic depends only on the declaration of the law; the FMU of an agent declares its terms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from cosim.verdict import Formation, Role, Verdict

__all__ = ["Member", "formation_of", "member", "rate", "settled"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True)
class Member:
    """One agent of a line: its id, the ids and gains of its neighbours, and whether it is stationary."""

    id: int
    neighbours: tuple[tuple[int, float], ...]
    stays: bool


def formation_of(verdicts: Mapping[str, Verdict]) -> tuple[str, Formation] | None:
    """Returns the output that an FMU declares as its desired position on a line, and the declaration."""
    return next(((name, one) for name, one in verdicts.items() if isinstance(one, Formation)), None)


def member(verdicts: Mapping[str, Verdict], parameters: Mapping[str, Any]) -> Member | None:
    """Returns the agent that follows a declared law with these values of its parameters.

    Returns None if its FMU declares no law or no system id, or if a value is missing.
    """
    found = formation_of(verdicts)
    own = next((name for name, one in verdicts.items() if one is Role.SYSTEM_ID), "")
    if found is None or not found[1].neighbours or own not in parameters:
        return None
    formation = found[1]
    if formation.stays and formation.stays not in parameters:
        return None
    neighbours: list[tuple[int, float]] = []
    for one in formation.neighbours:
        gain = parameters.get(one.gain) if isinstance(one.gain, str) else one.gain
        if one.id not in parameters or gain is None:
            return None
        if int(parameters[one.id]) != 0:
            neighbours.append((int(parameters[one.id]), float(gain)))
    stays = bool(formation.stays and parameters[formation.stays])
    return Member(int(parameters[own]), tuple(neighbours), stays)


def settled(members: Sequence[Member], held: Mapping[int, float]) -> dict[int, float] | None:
    """Returns the final positions of the mobile agents, by id.

    Returns None if no agent is mobile, a neighbour is missing, two agents have the same id, or the stationary agents do
    not determine the solution.

    Args:
        held: positions of the stationary agents, by id.
    """
    matrix = _matrix(members)
    free = [i for i, one in enumerate(members) if not one.stays]
    fixed = [i for i, one in enumerate(members) if one.stays]
    if matrix is None or not free or not all(np.isfinite(held.get(members[i].id, np.nan)) for i in fixed):
        return None
    grounded = matrix[np.ix_(free, free)]
    if np.linalg.matrix_rank(grounded, hermitian=_symmetric(grounded)) < len(free):
        return None
    ends = np.array([held[members[i].id] for i in fixed])
    point = np.linalg.solve(grounded, -matrix[np.ix_(free, fixed)] @ ends)
    return {members[i].id: float(x) for i, x in zip(free, point, strict=True)}


def rate(members: Sequence[Member]) -> float:
    """Returns the guaranteed factor by which a step shrinks the 2-norm of the distances to the final positions.

    Stationary agents divide a line into independent sections; the slowest section determines the factor.
    """
    return max((_rate(section) for section in _sections(members)), default=0.0)


def _rate(section: Sequence[Member]) -> float:
    index = {one.id: i for i, one in enumerate(section)}
    step = np.eye(len(section))
    for i, one in enumerate(section):
        for neighbour, gain in one.neighbours:
            step[i, i] -= gain
            if neighbour in index:
                step[i, index[neighbour]] += gain
    if _symmetric(step):  # equal gains: the 2-norm by eigenvalues takes a fifth of the time of singular values
        return float(np.abs(np.linalg.eigvalsh(step)).max())
    return float(np.linalg.norm(step, 2))


def _symmetric(matrix: Array) -> bool:
    return np.array_equal(matrix, matrix.T)


def _sections(members: Sequence[Member]) -> list[list[Member]]:
    """Returns the mobile agents, divided into groups that are linked by mobile neighbours."""
    free = {one.id: one for one in members if not one.stays}
    linked: dict[int, set[int]] = {number: set() for number in free}
    for one in free.values():
        for neighbour, _ in one.neighbours:
            if neighbour in free:
                linked[one.id].add(neighbour)
                linked[neighbour].add(one.id)
    sections: list[list[Member]] = []
    left = dict.fromkeys(free)
    while left:
        waiting, section = [next(iter(left))], []
        del left[waiting[0]]
        while waiting:
            number = waiting.pop()
            section.append(number)
            for other in linked[number]:
                if other in left:
                    del left[other]
                    waiting.append(other)
        sections.append([free[number] for number in sorted(section)])
    return sections


def _matrix(members: Sequence[Member]) -> Array | None:
    """Returns G; None if a neighbour of a mobile agent is missing, or if two agents have the same id."""
    index = {one.id: i for i, one in enumerate(members)}
    if len(index) < len(members):
        return None
    matrix = np.zeros((len(members), len(members)))
    for i, one in enumerate(members):
        if one.stays:
            continue
        for neighbour, gain in one.neighbours:
            if neighbour not in index:
                return None
            matrix[i, i] += gain
            matrix[i, index[neighbour]] -= gain
    return matrix
