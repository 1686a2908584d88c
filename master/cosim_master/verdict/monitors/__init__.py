"""Monitors that a system file declares: properties of signals, distances and packets, evaluated during the run.

declared    the annotation org.uav-cosim.monitors, checked against the system
formula     the language of signal temporal logic: from text to a tree
temporal    the evaluation of a tree, instant by instant
rules       limits, fences, convergence and formulas over sampled signals
formations  order and separation of vehicles
ages        the age of the last packet that a node heard from another
violations  begin, end and worst value of each violation
monitoring  the observer of a run that evaluates them all
reporting   its findings, in words
"""
