"""Look-up tables of a lens: profile textures and the lens ray transfer function, and their files."""
