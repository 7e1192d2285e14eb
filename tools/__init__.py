"""Tools for developers and for the build; not installed."""
