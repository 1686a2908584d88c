"""Readers of system files of all kinds; each returns a `structure`."""
