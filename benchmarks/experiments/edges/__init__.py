"""Experiments with depth edges, layers, rays and moving pictures."""
