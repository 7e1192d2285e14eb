"""Occluded background: structures and textures continued behind foregrounds."""
