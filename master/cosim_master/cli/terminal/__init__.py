"""Everything that verbs share on a terminal."""
