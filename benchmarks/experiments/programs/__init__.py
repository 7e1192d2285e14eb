"""Experiments with libraries, compilers, the studio and the page without a server."""
