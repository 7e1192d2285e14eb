"""Large arrays: blocks of rows, pyramids, resampling to another size.

In and out: NumPy arrays (H, W) or (H, W, C); ``pyramid.py`` takes tensors as well. No colour, no files.
"""
