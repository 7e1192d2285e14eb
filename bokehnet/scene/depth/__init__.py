"""Depth of a scene: maps from files and arrays, phones and networks, and layers of renderers.

In: a file, an array or a picture. Out: a :class:`~bokehnet.scene.depth.depth_map.DepthMap` in its own unit.

Open first: ``depth_map.py``, then ``depth_source.py``, which lists the kinds.
"""
