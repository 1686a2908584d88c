"""A study as data: `study` (the whole), `designs` (the points at which the factors are varied), `factors`."""
