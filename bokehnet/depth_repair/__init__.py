"""Repair of disparity maps: move depth edges to the edges of the picture.

In: the all-in-focus picture, scene-linear (H, W, 3), and its disparity (H, W), any unit. Out: a
:class:`~bokehnet.depth_repair.repair.RepairedMap` in the same unit, equal to the input where all edges are
accurate.

Open first: ``repair.py``, which lists the steps in order. ``diagnosis.py`` measures the errors of a map,
``stages/`` contains one correction per file, and ``acceptance.py`` decides where the repair replaces the
input; both use ``edge_profile.py``. ``config.py`` holds the numbers, ``filters.py`` what stages share.
``mixed_pixels.py`` and ``repeated_pixels.py`` correct files before the repair and need no picture.
"""
