"""The outcome of a run, and the manifest that states it."""
