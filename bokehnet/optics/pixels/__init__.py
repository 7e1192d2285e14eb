"""Pixels: filters, layers within a pixel, supersampling and resampling."""
