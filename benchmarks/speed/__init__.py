"""Commands that measure time and memory, and the rivals in the same run."""
