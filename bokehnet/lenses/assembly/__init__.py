"""Lenses as assembled: tolerances of their elements, and the misalignment of one copy."""
