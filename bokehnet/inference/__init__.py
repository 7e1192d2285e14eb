"""Rendering with trained networks, without torch."""
