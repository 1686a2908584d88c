"""The models that ship: one module per FMU, and beside them the physics and laws they share.

Nothing here knows the master: models and master meet in `cosim` and in .fmu files.
"""
