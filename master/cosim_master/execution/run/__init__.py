"""The state of a run in files."""
