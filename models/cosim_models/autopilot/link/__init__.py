"""Packets and texts on their links."""
