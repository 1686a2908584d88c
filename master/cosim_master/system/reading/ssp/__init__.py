"""SSP's own files: their grammar, their parts."""
