"""Descriptions of FMUs (and tables), as plain data."""
