"""Readers of system files of all formats; each returns a `structure`."""
