"""ArduPilot's own SITL as an FMU."""
