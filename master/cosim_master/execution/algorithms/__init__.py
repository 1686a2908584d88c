"""Masters beyond one fixed step: discarded steps, iteration, Richardson."""
