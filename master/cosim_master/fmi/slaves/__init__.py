"""Instances of FMUs behind one interface: FMI 1, 2, 3, Model Exchange, tables."""
