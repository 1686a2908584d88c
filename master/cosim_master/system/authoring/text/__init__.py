"""The text of SSP files: documents written, references found, differences told."""
