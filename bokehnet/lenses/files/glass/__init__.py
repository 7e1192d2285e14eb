"""Glasses of lens files: catalogues, discontinued names and media between surfaces."""
