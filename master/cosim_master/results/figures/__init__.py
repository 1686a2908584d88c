"""Figures of a run, for papers: `draw` writes all of them, one module for each kind of figure draws them."""
