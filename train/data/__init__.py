"""Training examples: prepared pictures, crops, and errors of depth maps."""
