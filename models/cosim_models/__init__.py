"""The models that ship: one module per FMU, and beside them the physics and laws they share.

Nothing here knows the master: models and master meet in `cosim` and in .fmu files.
"""

CHECKED = False
"""Their FMUs are built without checks of indices, for speed; the tests fly the same systems with checks."""
