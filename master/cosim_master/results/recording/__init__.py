"""The recording of a run, written while the run goes on."""
