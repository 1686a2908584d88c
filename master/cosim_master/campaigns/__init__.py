"""Campaigns: many runs of one system, spread over processes and machines by Dask, with one dataset as their result.

    campaign    a campaign from beginning to end: what is left to do, the runs in flight, progress, interruption
    search      points chosen by Optuna from the metrics of earlier ones
    running/    one run in a worker, prefixes that runs share, and the cluster
    report/     a report on a campaign: curves, heat maps, sensitivities, outliers
    dataset/    the folder of a campaign: a row for each run, written as runs end
    metrics/    numbers for a run: built-in ones, expressions over signals, Python functions
    study/      a study as data: factors, design, seeds, metrics

A study says which runs there are; a run is one call of `execution.simulate`, in a worker process that lives as long as
the campaign. The client alone writes the dataset, so that workers need no common folder for results.
"""
