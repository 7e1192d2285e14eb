"""Cluttered training scenes: grid meshes on the ground, with baked lighting."""
