"""Commands that print the figures of the README and the docs."""
