"""FMUs: what they say about themselves, and instances of them."""
