"""The results of a campaign: `folder` (its files, safe from a kill at any moment), `table` (columns, types, digest)."""
