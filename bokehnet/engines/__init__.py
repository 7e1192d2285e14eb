"""Engines: picture and signed defocus in, bokeh out, without torch.

In: an image (H, W, 3), scene-linear, the defocus in pixels (H, W), an aperture and a lens response. Out: the
picture, its coverage and its expected error. Strips and tiles bound the memory.

Open first: ``engine.py``; ``coarse_to_fine.py`` applies the networks. :mod:`bokehnet.engine_registry` lists
all engines.
"""
