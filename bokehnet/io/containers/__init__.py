"""File containers: location of their segments without decoding pixels, and input checks."""
