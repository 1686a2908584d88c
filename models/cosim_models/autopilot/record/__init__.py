"""The autopilot's record: variables and parameters."""
