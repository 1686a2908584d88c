"""The estimate while sensors fail: errors of inertial sensors, the filters of its lanes, and which lane flies."""
