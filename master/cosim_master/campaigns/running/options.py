"""The options of one run of a study, as of `uav-cosim run`; and the command that repeats it."""

from __future__ import annotations

import math
import shlex

from cosim_master.campaigns.running.place import Place, is_setting
from cosim_master.campaigns.study.study import Planned, Study
from cosim_master.execution.options import RunOptions

__all__ = ["commands", "options_of"]


def options_of(
    study: Study, place: Place, run: Planned, *, origin: str | None = None, before: float = math.inf
) -> RunOptions:
    """Returns the options of a run.

    Args:
        origin: RUN@TIME, the checkpoint from which it goes on; None: it begins at its start.
        before: leaves out the factors that act at this time [s] or later.
    """
    start, later = study.split(run.values)
    set_later = [(when, name, text) for when, values in sorted(later.items()) for name, text in values.items()]
    changes = [one for one in set_later if one[0] < before and not is_setting(one[1])]
    settings = {name: text for when, name, text in set_later if when < before and is_setting(name)}
    if origin is None:
        return RunOptions(
            overrides=start, at=[*study.at, *changes], until=study.until, step=study.step, seed=run.seed,
            variant=study.variant, solver=study.solver, record=place.record, threads=1,
        )  # fmt: skip
    return RunOptions(
        overrides=settings, at=[*study.at, *changes], origin=origin, step=study.step, variant=study.variant,
        solver=study.solver, threads=1,
    )  # fmt: skip


def commands(study: Study, run: Planned, begin: float) -> list[str]:
    """Returns the commands that repeat a run alone, for a shell: two, if a setting changes during it.

    Args:
        begin: the time at which the run begins, s, from which checkpoints are counted.
    """
    start, later = study.split(run.values)
    common = [*_option("--variant", study.variant), *_option("--solver", study.solver)]
    common += _option("--step", None if study.step is None else f"{study.step:.12g}")
    words = ["uav-cosim", "run", study.system, *common, *_settings(start)]
    words += _option("--seed", run.seed) + _option("--until", None if study.until is None else f"{study.until:.12g}")
    set_later = [(when, name, text) for when, values in sorted(later.items()) for name, text in values.items()]
    changes = [*study.at, *(one for one in set_later if not is_setting(one[1]))]
    at = [word for when, name, text in changes for word in ("--at", f"{when:.9g}", f"{name}={text}")]
    settings = {name: text for _, name, text in set_later if is_setting(name)}
    folder = f"run-{run.run}"
    if not settings:
        return [shlex.join([*words, *at, "-o", folder])]
    time = next(when for when, name, _ in set_later if is_setting(name))
    first = [*words, *at, "--checkpoint-every", f"{time - begin:.9g}", "-o", f"{folder}-begin"]
    branch = ["uav-cosim", "run", study.system, *common, "--from", f"{folder}-begin@{time:.9g}", *_settings(settings)]
    return [shlex.join(first), shlex.join([*branch, *at, "-o", folder])]


def _option(name: str, value: object) -> list[str]:
    return [] if value is None else [name, str(value)]


def _settings(values: dict[str, str]) -> list[str]:
    return [word for name, text in values.items() for word in ("--set", f"{name}={text}")]
