"""The autopilot's variables: its record, its parameters."""
