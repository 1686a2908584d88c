"""The models that ship, in independent packages: vehicles, sensing, agents, autopilot, ardupilot.

The models do not depend on the master: models and master meet in `cosim` and in .fmu files.
"""

CHECKED = False
"""The FMUs of this package are built without index checks, for speed; the tests fly the same systems with checks."""
