"""Geometry of the ray tracer: rays, shapes and their intersections."""
