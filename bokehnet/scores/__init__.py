"""How close two pictures are, in NumPy alone; in go pictures as they are shown, sRGB in [0, 1].

Open first: :mod:`bokehnet.scores.flip`.
"""
