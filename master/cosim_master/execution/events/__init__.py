"""Clocks and Event Mode of FMI 3."""
