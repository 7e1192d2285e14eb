"""Formulas of geometrical optics, each in one place; no state and no files."""
