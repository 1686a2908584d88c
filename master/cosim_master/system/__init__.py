"""System descriptions in SSP and other formats: from files to a checked, flat system, and back to files."""
