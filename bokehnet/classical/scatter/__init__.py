"""Scatter: every pixel spreads its light over the shape of the aperture, blind to occlusion.

In: values (H, W, C), signed defocus in pixels (H, W), an :class:`bokehnet.optics.aperture.Aperture`.
Out: sums (H, W, C), not yet divided by the weights, and the adjoints of all that; the renderer that
normalises them is :mod:`bokehnet.classical.scatter_renderer`.

Open first: ``disc_scatter.py``, discs on one grid, exact; ``disc_table.py`` has their coverage of pixels.
Then ``pyramid_levels.py`` (large discs on smaller pictures; ``pyramid_merging.py``, ``pyramid_lattices.py``),
``aperture_scatter.py`` (any other shape; ``aperture_table.py``, ``cats_eye.py``), ``operators.py`` (from an
aperture to one of the two), ``scanline_spans.py`` (shapes as rows of equal light, for torch) and
``oracle.py`` (slow and obviously right).

Imports ``simd``, no other room of ``classical``.
"""
