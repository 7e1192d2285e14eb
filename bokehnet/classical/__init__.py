"""Classical renderers: bokeh without learned parts, as NumPy functions and numba kernels.

In: an all-in-focus picture, scene-linear (H, W, 3), its signed defocus in pixels (H, W), an aperture, and
what the lens does beyond focusing. Out: a :class:`bokehnet.classical.base.ClassicalResult`.

Open first: ``base.py``, what every renderer takes and gives; then the two renderers, ``scatter_renderer.py``
and ``rays_renderer.py``. What they are made of stands in the rooms ``scatter``, ``layered``, ``highlights``;
``simd`` lies below them, and ``torch`` is the scatter once more with gradients. Three files serve several
rooms: ``error_map.py`` (where the scatter can be wrong), ``highlight_detection.py`` (which pixels are bright
lights) and ``parallel.py`` (the lock around parallel kernels).

Imports: the renderers > ``highlights`` > ``layered``, ``scatter`` > ``simd``; never the reverse.
"""
