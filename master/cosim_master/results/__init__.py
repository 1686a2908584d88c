"""Recordings: written, compared, exported, drawn."""
