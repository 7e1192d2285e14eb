"""Selection of the picture channels among the parts, views and layers of a file."""
