"""Similarity scores of two pictures in NumPy; inputs are display pictures, sRGB in [0, 1].

Open first: :mod:`bokehnet.scores.flip`.
"""
