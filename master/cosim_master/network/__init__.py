"""Transport of packets: the radio inside the loop, and gateways to external programs."""
