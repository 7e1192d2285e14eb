"""Experiments with looks, effects, lamps and fits of looks."""
