"""Encoders: arrays to image files, and HEIF and AVIF, which encode a picture as a whole."""
