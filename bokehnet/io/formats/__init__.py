"""Encoders of image files: band by band, or as a whole for HEIF and AVIF."""
