"""Training scripts and their helper modules."""
