"""What FMUs (and tables) say about themselves, as plain data."""
