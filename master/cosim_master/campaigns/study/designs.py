"""Designs: the points of a study.

    grid           every combination of the values of all factors
    lhs:N          N points of a Latin hypercube (scipy.stats.qmc)
    sobol:N        N points of a scrambled Sobol sequence (scipy.stats.qmc); a power of two keeps its balance
    morris:N       N trajectories for Morris' elementary effects (SALib): N * (factors + 1) points
    indices:N      Saltelli's points for Sobol indices (SALib): N * (factors + 2) points

All except grid draw from a generator with the seed of the design: the same study has the same points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from cosim_master.campaigns.refusal import refusal
from cosim_master.campaigns.study.factors import Factor
from cosim_master.execution.options import whole

__all__ = ["KINDS", "Array", "Design", "Point", "points", "problem", "shares"]

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Point: TypeAlias = dict[str, str]
"""The value of each factor, as a text, by its label."""

KINDS = ("grid", "lhs", "sobol", "morris", "indices")
_MOST = 10_000_000
"""Points of a study."""
MORRIS_LEVELS = 4
"""Levels of Morris' grid."""


@dataclass(frozen=True, slots=True)
class Design:
    """A design.

    Attributes:
        kind: one of `KINDS`.
        size: number of points, of trajectories (morris), or of base points (indices); 0 for a grid.
        seed: of the design's own random numbers.
    """

    kind: str = "grid"
    size: int = 0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("size", "seed"):
            object.__setattr__(self, name, whole(name, getattr(self, name)))
        where = f"--sample {self.kind}" + (f":{self.size}" if self.size else "")
        if self.kind not in KINDS:
            raise refusal(where, f"there is no such design; valid: grid, {', '.join(f'{k}:N' for k in KINDS[1:])}")
        if self.kind == "grid" and self.size:
            raise refusal(where, "a grid has all combinations of the factors' values; leave out the number")
        if self.kind != "grid" and not 2 <= self.size <= _MOST:
            raise refusal(where, f"give a number of at least 2, as in {self.kind}:64")

    @classmethod
    def parsed(cls, text: str) -> Design:
        """Returns the design of a text such as "lhs:500".

        Raises:
            SystemDescriptionError: there is no such design.
        """
        kind, _, size = text.partition(":")
        if size and not size.isdecimal():
            raise refusal(f"--sample {text}", f"write {kind}:NUMBER")
        return cls(kind, int(size or 0))


def points(design: Design, factors: Sequence[Factor]) -> list[Point]:
    """Returns the points of a study.

    Raises:
        SystemDescriptionError: a grid has a factor without values, or the design needs more factors or fewer points.
    """
    if design.kind != "grid":
        if not factors:
            raise refusal(f"--sample {design.kind}", "there is nothing to vary; give --vary NAME=FROM:TO")
        found = shares(design, factors)
        return [{one.label: one.at(float(share)) for one, share in zip(factors, row, strict=True)} for row in found]
    if open_ones := [one.label for one in factors if one.continuous]:
        text = (
            "a grid needs a number of values; write FROM:TO:NUMBER, or choose a design that samples (--sample lhs:100)"
        )
        raise refusal(f"factor {open_ones[0]}", text)
    if math.prod(len(one.values) for one in factors) > _MOST:
        raise refusal("--sample grid", f"it has more than {_MOST} points; vary less, or sample (--sample lhs:1000)")
    combinations = itertools.product(*(one.values for one in factors))
    return [{one.label: value for one, value in zip(factors, row, strict=True)} for row in combinations]


def shares(design: Design, factors: Sequence[Factor]) -> Array:
    """Returns the points of a design that samples: (points, factors), each value a share from 0 to 1 of its factor."""
    count = len(factors)
    if design.kind in ("lhs", "sobol"):
        from scipy.stats import qmc

        if design.kind == "lhs":
            drawn: Array = qmc.LatinHypercube(count, rng=design.seed).random(design.size)
            return drawn
        sequence = qmc.Sobol(count, rng=design.seed)
        whole: Array = sequence.random_base2(math.ceil(math.log2(design.size)))
        return whole[: design.size]
    if design.kind == "morris":
        from SALib.sample import morris

        found: Array = morris.sample(problem(factors), design.size, num_levels=MORRIS_LEVELS, seed=design.seed)
        return found
    from SALib.sample import sobol

    base = 2 ** math.ceil(math.log2(design.size))
    if base != design.size:
        raise refusal(f"--sample indices:{design.size}", f"the number is a power of two; try {base}")
    rows: Array = sobol.sample(problem(factors), design.size, calc_second_order=False, seed=design.seed)
    return rows


def problem(factors: Sequence[Factor]) -> Mapping[str, Any]:
    """Returns the factors as SALib takes them: each varies from 0 to 1, a share of its range."""
    names = [one.label for one in factors]
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
