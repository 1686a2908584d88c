"""Coordination agents and the laws they follow."""
