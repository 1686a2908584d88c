"""The autopilot that answers as ArduCopter does."""
