"""The master: reads a system of FMUs, checks it, steps it, carries its packets, records it.

Nothing is imported here, so that each command loads only what it needs.
"""
