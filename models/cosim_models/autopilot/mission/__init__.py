"""Missions, fences and rally points, as they are stored."""
