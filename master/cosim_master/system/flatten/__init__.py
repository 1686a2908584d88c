"""From a structure to a checked system: instances, links and start values with all names resolved."""
