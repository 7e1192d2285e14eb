"""Tools of the developers and of the build: not installed."""
