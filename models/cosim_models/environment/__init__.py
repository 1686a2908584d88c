"""The surroundings that vehicles share: wind, obstacles, and each other."""
