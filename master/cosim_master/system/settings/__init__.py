"""Settings of a checked system: time, master, network, changes during the run."""
