"""A study: a system, the factors varied in it, the design, seeds, and the metrics of each run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cosim_master.campaigns.metrics.metric import Metric
from cosim_master.campaigns.refusal import refusal, several
from cosim_master.campaigns.study.designs import Design, Point, points
from cosim_master.campaigns.study.factors import Factor
from cosim_master.diagnostics.names import matching
from cosim_master.execution.options import RunOptions, seed_number

__all__ = ["FIXED", "Planned", "Search", "Study"]

FIXED = ("run", "point", "seed", "outcome", "reason", "good", "failures", "warnings", "findings", "simulated_s")
"""The columns that every dataset has."""


@dataclass(frozen=True, slots=True)
class Planned:
    """A run of a study: its number, the number of its point, the values of the factors, and its seed."""

    run: int
    point: int
    values: Point
    seed: int | None


@dataclass(frozen=True, slots=True)
class Search:
    """A search for the least or greatest value of a metric, as the mean over the seeds of a point.

    Attributes:
        metric: its name.
        minimise: whether the least value is sought.
        trials: number of points.
        batch: points that are chosen at once.
    """

    metric: str
    minimise: bool = True
    trials: int = 100
    batch: int = 8

    @classmethod
    def parsed(cls, text: str, trials: int) -> Search:
        """Returns the search of a text such as "min error_to_law".

        Raises:
            SystemDescriptionError: the text names no direction or no metric.
        """
        way, _, metric = text.strip().partition(" ")
        if way not in ("min", "max") or not metric.strip():
            raise refusal(f"--optimise {text}", "write min METRIC or max METRIC")
        return cls(metric.strip(), way == "min", trials)


def _parts(name: str, given: Any, kind: type[Factor] | type[Metric], example: str) -> tuple[Any, ...]:
    """Returns the factors or metrics of a study, some of which are given as text.

    Raises:
        SystemDescriptionError: one of them is neither.
    """
    items = several(name, given, f"{name}=({example!r},)")
    if wrong := [one for one in items if not isinstance(one, str | kind)]:
        what = kind.__name__
        raise refusal(name, f"contains {wrong[0]!r}, not a {what}; try {what}.parsed({example!r}), or this text itself")
    return tuple(kind.parsed(str(one)) if isinstance(one, str) else one for one in items)


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A study. Everything that it consists of is plain data: `as_json` writes it, `of_json` reads it.

    Paths may be given instead of text, texts as in `parsed` instead of factors and metrics, numbers instead of values,
    and numbers and arrays of numpy.

    Attributes:
        system: an .ssd, .ssp, .fmu or folder, or the name of a shipped system, as of `simulate`.
        factors: the values that are varied.
        design: the points at which they are varied.
        seeds: each point is run with each of these seeds of the radio; if empty, with that of the system.
        metrics: the numbers computed for each run.
        keep: patterns of signals that are kept of every run.
        search: chooses the points by the metrics of earlier ones, instead of the design; None: the design does.
        overrides, at, until, step, variant, solver: of all runs, as in `RunOptions`.
    """

    system: str
    factors: tuple[Factor, ...] = ()
    design: Design = field(default_factory=Design)
    seeds: tuple[int, ...] = ()
    metrics: tuple[Metric, ...] = ()
    keep: tuple[str, ...] = ()
    search: Search | None = None
    overrides: Mapping[str, str] = field(default_factory=dict)
    at: tuple[tuple[float, str, str], ...] = ()
    until: float | None = None
    step: float | None = None
    variant: str | None = None
    solver: str | None = None

    def __post_init__(self) -> None:
        self._take()
        varied = [one.label for one in self.factors]
        if twice := [name for n, name in enumerate(varied) if name in varied[:n]]:
            raise refusal(f'--vary "{twice[0]}"', "it is varied twice; give all its values in one --vary")
        at_start = [one.name for one in self.factors if one.time is None]
        for name in at_start:
            if covered := [x for x in matching(name, [*at_start, *self.overrides]) if x != name]:
                text = f"this pattern matches {covered[0]}, too, which would have no effect; leave out one of them"
                raise refusal(f'--vary "{name}"', text)
            if name in self.overrides:
                raise refusal(f'--vary "{name}"', "it is set by --set, too, which would have no effect; leave out one")
        if fixed := [name for name in varied if name in FIXED]:
            text = f"the dataset has a column of this name; give a variable of this name as COMPONENT.{fixed[0]}"
            if fixed[0] == "seed":
                text += "; seeds of the radio are varied by --seeds"
            raise refusal(f'--vary "{fixed[0]}"', text)
        labels = [*FIXED, *(one.label for one in self.factors), *(one.name for one in self.metrics)]
        if twice := [name for n, name in enumerate(labels) if name in labels[:n]]:
            text = "the dataset has a column of this name already; give another name (--metric NAME=...)"
            raise refusal(f'"{twice[0]}"', text)
        if len({*self.seeds}) < len(self.seeds):
            raise refusal("--seeds", "a seed is given twice; give each once")
        if self.search is not None and self.search.metric not in [one.name for one in self.metrics]:
            names = ", ".join(one.name for one in self.metrics)
            raise refusal(f"--optimise {self.search.metric}", f"there is no metric of this name; valid: {names}")
        if self.search is not None and (not self.factors or self.design.kind != "grid"):
            raise refusal("--optimise", "it needs factors (--vary), and chooses the points itself; leave out --sample")
        if both := [one.name for one in self.factors if one.name == "network.seed"]:
            raise refusal(f"factor {both[0]}", "seeds are varied by --seeds; leave out the factor")

    def _take(self) -> None:
        """Turns what is given in another type into the types of the attributes.

        Raises:
            SystemDescriptionError: it is of a kind that cannot be meant.
        """
        if not isinstance(self.system, str | os.PathLike):
            raise refusal("system", f"is {self.system!r}, not a path; try system='line5'")
        seeds = several("seeds", self.seeds, "seeds=range(1, 11)")
        run = RunOptions(overrides=self.overrides, at=self.at, until=self.until, step=self.step)
        for name, taken in {
            "system": os.fspath(self.system),
            "factors": _parts("factors", self.factors, Factor, "network.loss=0,0.1"),
            "seeds": tuple(seed_number("seeds", seed) for seed in seeds),
            "metrics": _parts("metrics", self.metrics, Metric, "error_to_law"),
            "keep": tuple(map(str, several("keep", self.keep, 'keep=("*.vehicle.*",)'))),
            "overrides": run.overrides,
            "at": run.at,
            "until": run.until,
            "step": run.step,
        }.items():
            object.__setattr__(self, name, taken)

    def runs(self) -> list[Planned]:
        """Returns all runs: point by point, and seed by seed within a point; none of a search, which chooses them.

        Raises:
            SystemDescriptionError: the design does not fit the factors.
        """
        seeds: Sequence[int | None] = self.seeds or (None,)
        if self.search is not None:
            return []
        return [
            Planned(p * len(seeds) + s, p, values, seed)
            for p, values in enumerate(points(self.design, self.factors))
            for s, seed in enumerate(seeds)
        ]

    @property
    def count(self) -> int:
        """The number of runs."""
        if self.search is None:
            return len(self.runs())
        return self.search.trials * max(1, len(self.seeds))

    def split(self, values: Mapping[str, str]) -> tuple[dict[str, str], dict[float, dict[str, str]]]:
        """Returns the overrides of a run from its start, and those from later times on, by time [s]."""
        start = dict(self.overrides)
        later: dict[float, dict[str, str]] = {}
        for one in self.factors:
            if one.time is None:
                start.pop(one.name, None)  # so that it also takes precedence over patterns after it
                start[one.name] = values[one.label]
            else:
                later.setdefault(one.time, {})[one.name] = values[one.label]
        return start, later

    def as_json(self) -> dict[str, Any]:
        """Returns the study as a JSON document."""
        return {
            "system": self.system,
            "factors": [one.as_json() for one in self.factors],
            "design": {"kind": self.design.kind, "size": self.design.size, "seed": self.design.seed},
            "seeds": list(self.seeds),
            "metrics": [one.as_json() for one in self.metrics],
            "keep": list(self.keep),
            "search": None if self.search is None else asdict(self.search),
            "overrides": dict(self.overrides),
            "at": [list(one) for one in self.at],
            "until": self.until,
            "step": self.step,
            "variant": self.variant,
            "solver": self.solver,
        }

    @classmethod
    def of_json(cls, told: Mapping[str, Any]) -> Study:
        """Returns the study of a JSON document.

        Raises:
            SystemDescriptionError: it is no study.
        """
        try:
            design = told.get("design") or {}
            return cls(
                system=str(told["system"]),
                factors=tuple(map(Factor.of_json, told.get("factors", ()))),
                design=Design(design.get("kind", "grid"), int(design.get("size", 0)), int(design.get("seed", 1))),
                seeds=tuple(map(int, told.get("seeds", ()))),
                metrics=tuple(map(Metric.of_json, told.get("metrics", ()))),
                keep=tuple(map(str, told.get("keep", ()))),
                search=None if told.get("search") is None else Search(**told["search"]),
                overrides={str(name): str(text) for name, text in (told.get("overrides") or {}).items()},
                at=tuple((float(time), str(name), str(text)) for time, name, text in told.get("at", ())),
                until=told.get("until"),
                step=told.get("step"),
                variant=told.get("variant"),
                solver=told.get("solver"),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise refusal("the study", f"is not one: {error!r}") from None

    def digest(self) -> str:
        """Returns the digest of everything that the study says, without the place of its system."""
        told = {**self.as_json(), "system": Path(self.system).name}
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
