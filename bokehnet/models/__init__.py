"""The two networks and how they are stored and exported. Needs torch: pip install 'bokehnet[train]'."""
