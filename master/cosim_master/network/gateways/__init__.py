"""Sockets to real programs."""
