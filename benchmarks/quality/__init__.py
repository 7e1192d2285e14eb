"""Commands that measure quality against a truth, and their scenes and tables."""
