"""One system in several processes: the cut, the exchange of packets and values, and the recording as one."""
