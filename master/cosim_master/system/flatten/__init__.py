"""Converts a structure to a checked, flat system of instances, connections and start values, with names resolved."""
