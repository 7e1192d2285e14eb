"""Cluttered training scenes: objects of bent grids on the ground, with baked light."""
