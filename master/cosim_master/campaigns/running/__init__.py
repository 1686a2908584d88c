"""Runs in workers.

cluster     a cluster of this machine, or the client of another one
task        one run: from values and seed to a row
prefix      the beginning that several runs share: simulated once, up to a checkpoint
place       the system of a study as a process sees it: checked once, with the signals that its metrics need
"""
