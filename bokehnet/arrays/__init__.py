"""Large arrays: blocks of rows, pyramids, resampling to another size, position in the displayed picture.

In and out: NumPy arrays (H, W) or (H, W, C); ``pyramid.py`` also accepts tensors. No color, no files.
"""
