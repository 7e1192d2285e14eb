"""Lookup tables of a lens, and their files: profile textures and the lens ray transfer function."""
