"""Packets and status texts on the autopilot's links."""
