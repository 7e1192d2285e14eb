"""Scatter: every pixel spreads its light over the shape of the aperture, without occlusion.

In: values (H, W, C), signed defocus in pixels (H, W), an :class:`bokehnet.optics.aperture.Aperture`.
Out: sums (H, W, C), not yet divided by the weights, and the adjoints; the renderer that normalises the sums
is :mod:`bokehnet.classical.scatter_renderer`.

Open first: ``disc_scatter.py``, exact discs on one grid; ``disc_table.py`` has their coverage of pixels. Then
``pyramid_levels.py`` (large discs on smaller pictures; ``pyramid_merging.py``, ``pyramid_lattices.py``),
``aperture_scatter.py`` (any other shape; ``aperture_table.py``, ``cats_eye.py``), ``operators.py`` (selects
one of the two for an aperture), ``scanline_spans.py`` (shapes as rows of equal light, for torch) and
``oracle.py`` (slow reference).

Imports ``simd``, no other room of ``classical``.
"""
