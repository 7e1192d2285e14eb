"""The occluded background: structures and textures carried on behind foregrounds."""
