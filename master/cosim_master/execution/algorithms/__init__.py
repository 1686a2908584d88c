"""Master algorithms beyond one fixed step: discarded steps, iteration, variable steps."""
