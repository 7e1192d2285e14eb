"""Losses, metrics, evaluation sets and tables of scores."""
