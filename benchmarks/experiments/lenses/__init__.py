"""Experiments with lenses, aberrations and point spread functions."""
