"""Gathering methods of the literature: each pixel averages samples around it."""
