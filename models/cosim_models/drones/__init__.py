"""Whole drones in one FMU: a point mass, its guidance and the law of an agent, for the largest swarms."""
