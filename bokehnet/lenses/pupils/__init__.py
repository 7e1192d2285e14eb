"""Pupils of a lens: paraxial, effective, and the shift of focus with the aperture."""
