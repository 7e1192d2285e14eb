"""Separable and diffusing filters of the literature."""
