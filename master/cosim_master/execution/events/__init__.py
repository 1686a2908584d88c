"""Clocks and Event Mode."""
