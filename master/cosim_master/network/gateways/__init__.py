"""Gateways: sockets to external programs."""
