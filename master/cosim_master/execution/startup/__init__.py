"""Start-up: from loaded FMUs to initialized instances."""
