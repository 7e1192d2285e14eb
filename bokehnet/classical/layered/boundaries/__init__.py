"""Depth edges inside pixels: unmixing, boundaries inside pixels, and the pixel filter of a picture."""
