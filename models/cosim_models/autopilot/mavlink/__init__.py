"""Messages: commands received, telemetry sent, parameters, files."""
