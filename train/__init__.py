"""Training scripts, and what only they need."""
