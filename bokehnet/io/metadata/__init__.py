"""Metadata of pictures: EXIF, XMP, camera attributes, and the program that wrote a file."""
