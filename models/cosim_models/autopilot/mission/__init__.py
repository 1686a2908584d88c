"""Storage of missions, fences and rally points."""
