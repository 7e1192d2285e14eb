"""Spreading methods of the literature: each pixel writes its point spread function."""
