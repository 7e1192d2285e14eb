"""Depth edges inside pixels: mixed pixels unmixed, boundaries, the pixel filter of a picture."""
