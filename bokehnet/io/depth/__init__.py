"""Depth maps that phones embed in photos: one module per vendor, and their common value coding."""
