"""The models that ship, in rooms that do not know each other: vehicles, sensing, agents, autopilot, ardupilot.

Nothing here knows the master: models and master meet in `cosim` and in .fmu files.
"""

CHECKED = False
"""Their FMUs are built without checks of indices, for speed; the tests fly the same systems with checks."""
