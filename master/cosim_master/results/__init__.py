"""Recordings: their files, comparison, export and figures."""
