"""Aberrations as formulas: the aberration map, Seidel and Zernike terms, chromatic errors, distortion."""
