"""ArduPilot's SITL as an FMU."""
