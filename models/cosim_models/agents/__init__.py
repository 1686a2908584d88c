"""Coordination agents and the laws that they follow."""
