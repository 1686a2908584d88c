"""Systems written: new, changed, saved, packed, converted, drawn."""
