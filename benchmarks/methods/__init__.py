"""Methods of others, for comparison with those of the package."""
