"""Surfaces of the ray tracer: materials, textures, lights."""
