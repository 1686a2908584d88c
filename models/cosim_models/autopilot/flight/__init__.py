"""Flight modes: how each flies."""
