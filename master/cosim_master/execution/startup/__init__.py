"""From loaded FMUs to initialised instances."""
