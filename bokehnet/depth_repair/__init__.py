"""Repair of disparity maps: move depth edges to the edges of the picture.

In: the all-in-focus picture, scene-linear (H, W, 3), and its disparity (H, W), any unit. Out: a
:class:`~bokehnet.depth_repair.repair.RepairedMap` in the same unit, equal to the input where all edges are
accurate.

Open first: ``repair.py``, which lists the stages in order. ``edge_bias.py`` and ``map_offset.py`` estimate
errors common to all edges, and ``edge_profile.py`` confirms them without a network. ``stages/`` contains one
correction per file. ``acceptance.py`` decides where the repair replaces the input.
"""
