"""Swarms: built in Python or from a scenario, and written as system folders."""
