"""Bytes from strangers: archives, XML with line numbers, XML edited byte for byte."""
