"""Controllers from position to motors."""
