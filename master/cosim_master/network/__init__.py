"""Packets on their way: the radio inside of the loop, and gateways to the outside."""
