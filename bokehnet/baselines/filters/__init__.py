"""Separable filters and diffusion of the literature."""
