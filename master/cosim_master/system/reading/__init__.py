"""From files of all kinds to `structure`."""
