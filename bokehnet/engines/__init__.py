"""Engines: picture and signed defocus in, bokeh out, without torch.

In: an image (H, W, 3), scene-linear, the defocus in pixels (H, W), an aperture and a lens response. Out: the
picture, its coverage and its expected error. Memory is bounded by strips and tiles.

Open first: ``engine.py``; ``coarse_to_fine.py`` applies the networks. The rows of all engines
stand in :mod:`bokehnet.engine_registry`.
"""
