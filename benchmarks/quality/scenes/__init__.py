"""Scenes with a known truth: traced, with clipped light, with faults in closed form."""
