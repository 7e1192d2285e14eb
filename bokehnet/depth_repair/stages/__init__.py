"""Stages of the depth repair, one a file: noise, soft edges, position, blur, thin structures.

In: a map (H, W) and, for most stages, the picture, scene-linear (H, W, 3). Out: a map of the same size and
unit. Each module docstring names the published method.
"""
