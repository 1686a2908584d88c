"""A search: points chosen by Optuna from the metrics of the runs so far.

Points are asked for in batches of fixed size, and a batch is told as a whole, in the order of its points. So the points
depend on the study alone, whatever the number of workers and the order in which runs end; and a search that was
interrupted goes on by asking again for the batches that have ended, and telling their metrics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from cosim_master.campaigns.study.study import Planned, Search, Study

__all__ = ["batches"]


def batches(study: Study, search: Search, value: Callable[[Planned], float | None]) -> Iterator[list[Planned]]:
    """Yields the runs of each batch; the next one is asked for when these have ended.

    Args:
        value: returns the metric of a run that has ended; None if it has none.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    made = optuna.create_study(
        direction="minimize" if search.minimise else "maximize",
        sampler=optuna.samplers.TPESampler(seed=study.design.seed),
    )
    seeds = study.seeds or (None,)
    for begin in range(0, search.trials, search.batch):
        asked = [(begin + n, made.ask()) for n in range(min(search.batch, search.trials - begin))]
        runs = {
            point: [Planned(point * len(seeds) + s, point, values, seed) for s, seed in enumerate(seeds)]
            for point, trial in asked
            for values in [_values(study, trial)]
        }
        yield [run for group in runs.values() for run in group]
        for point, trial in asked:
            found = [value(run) for run in runs[point]]
            if any(one is None for one in found):
                made.tell(trial, state=optuna.trial.TrialState.FAIL)
            else:
                made.tell(trial, float(np.mean([one for one in found if one is not None])))


def _values(study: Study, trial: Any) -> dict[str, str]:
    """Returns the values of the factors that a trial proposes."""
    found = {}
    for one in study.factors:
        if one.continuous:
            found[one.label] = f"{trial.suggest_float(one.label, one.low, one.high):.12g}"
        else:
            found[one.label] = trial.suggest_categorical(one.label, list(one.values))
    return found
