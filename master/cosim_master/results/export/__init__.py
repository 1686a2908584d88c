"""A recorded run in the formats of other tools: one module for each format, registered in `formats`."""
