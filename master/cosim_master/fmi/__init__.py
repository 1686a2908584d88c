"""FMUs: descriptions and instances."""
