"""Measurements of the theses, repeated with this package; see ``docs/method/theses_measurements.md``."""
