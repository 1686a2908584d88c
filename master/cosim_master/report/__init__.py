"""A report on runs as one HTML page: `page` writes it, `contents` gathers it, `structure` draws the system."""
