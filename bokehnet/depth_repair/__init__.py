"""Repair of disparity maps: depth edges moved to the edges of the picture.

In: the all-in-focus picture, scene-linear (H, W, 3), and its disparity (H, W). Out: a
:class:`~bokehnet.depth_repair.repair.RepairedMap`, equal to the input wherever no edge is out of place.

Open first: ``repair.py`` (the order of the stages). ``edge_bias.py`` and ``map_offset.py`` measure errors
that all edges share, ``stages/`` holds one correction a file, ``acceptance.py`` decides where a correction is
kept.
"""
