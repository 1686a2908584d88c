"""Writers of systems: new, changed, saved, packed, converted and drawn systems."""
