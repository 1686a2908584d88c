"""What a run needs before an FMU is loaded: the checked system, its inputs over time, the fingerprint of all inputs."""
