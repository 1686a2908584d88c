"""SSP and its relatives, from files to a checked, flat system, and back."""
