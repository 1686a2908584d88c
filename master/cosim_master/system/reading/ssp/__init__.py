"""Readers of SSP's own files: their grammar, and their parts."""
