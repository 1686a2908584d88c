"""Names of MAVLink messages, for people."""

from __future__ import annotations

from functools import cache

__all__ = ["message_names"]


@cache
def message_names() -> dict[int, str]:
    """Returns message names by id: with pymavlink all messages of ArduPilot, otherwise those that models can send."""
    try:
        from pymavlink.dialects.v20 import ardupilotmega
    except ImportError:
        from cosim import messages

        return {getattr(messages, n): n for n in dir(messages) if hasattr(messages, f"encode_{n.lower()}")}
    return {number: str(message.msgname) for number, message in ardupilotmega.mavlink_map.items()}
