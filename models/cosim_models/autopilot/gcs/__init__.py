"""The MAVLink side that the small autopilots share: ports, streams, commands, targets, parameters and missions."""
