"""Gathering methods of the literature: each pixel collects samples around it."""
