"""Instances of FMUs with a common interface: FMI 1, 2, 3, Model Exchange, tables."""
