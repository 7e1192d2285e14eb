"""Commands of one file each; heavy imports stay inside the functions."""
