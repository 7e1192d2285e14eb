"""Colour spaces of files: primaries, transfer curves, ICC profiles and dithering."""
