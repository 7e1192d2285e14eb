"""Files in and out: pictures, maps, and the colour between them."""
