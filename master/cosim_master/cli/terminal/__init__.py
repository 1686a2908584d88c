"""The parts that all verbs share: consoles, options, progress and the registry of verbs."""
