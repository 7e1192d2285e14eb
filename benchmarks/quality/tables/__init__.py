"""Tables of the results of several methods."""
