"""Classical renderers: bokeh without learned components, as NumPy functions and numba kernels.

In: an all-in-focus picture, scene-linear (H, W, 3), its signed defocus in pixels (H, W), an aperture, and
the aberrations of the lens. Out: a :class:`bokehnet.classical.base.ClassicalResult`.

Open first: ``base.py``, the interface of all renderers; then the two renderers, ``scatter_renderer.py``
and ``rays_renderer.py``. Their components are in the rooms ``scatter``, ``layered`` and ``highlights``;
``simd`` is below them, and ``torch`` is the scatter with gradients. Three files serve several rooms:
``error_map.py`` (expected error of the scatter), ``highlight_detection.py`` (bright lights) and
``parallel.py`` (the lock around parallel kernels).

Imports: the renderers > ``highlights`` > ``layered``, ``scatter`` > ``simd``; never the reverse.
"""
