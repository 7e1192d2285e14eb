"""Containers of files: the position of their pieces, found without decoding pixels, and input checks."""
