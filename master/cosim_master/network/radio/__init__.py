"""The radio: topology, channel, queues and routing of packets."""
