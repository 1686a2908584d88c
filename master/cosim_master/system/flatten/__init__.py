"""Flattening: from a structure to a checked system of instances, connections and start values, with names resolved."""
