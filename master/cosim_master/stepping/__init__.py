"""The plan of a run and the compiled loop that executes it."""
