"""Ray-based methods of the literature: rays through layers, height fields and meshes."""
