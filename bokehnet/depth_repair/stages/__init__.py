"""Stages of the depth repair, one a file: noise, soft edges, blur, mixed pixels, thin structures.

Each takes a map (H, W), most take the picture too, and returns a map of the same size and unit.
"""
