"""Tables and texts that verbs print."""
