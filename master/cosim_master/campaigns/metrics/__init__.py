"""Metrics, the numbers computed for each run.

metric        one metric: its name, and its expression or Python function
expression    the grammar of expressions, and their values
built_in      settling time, error to the law, nearest approach, packets, energy
measured      the signals of a run in memory, and the observer that collects them
"""
