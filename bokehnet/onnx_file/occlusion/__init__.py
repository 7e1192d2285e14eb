"""Occlusion in the file: mixed pixels, layers, and the rays through them.

Open first: ``rays.py``, which marches through the two layers that ``layers.py`` estimates; ``unmixing.py``
separates the colours of pixels at depth edges.
"""
