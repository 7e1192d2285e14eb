"""Layered rays: pupil rays marched through the picture as a stack of layers.

In: picture (H, W, 3), signed defocus in pixels (H, W), optionally the aberrations of the lens.
Out: layers with their occluded background; for each pixel the light that its rays meet, and the
disocclusion weight.

Open first: ``layers.py``, from a picture to layers; it uses ``depth_discontinuities.py``,
``boundaries/unmixing.py`` and ``background/occluded_background.py``. Then ``march/ray_marching.py``, the loop
over pixels and rays: defocus ranges in which rays can meet a surface (``defocus_bins.py``), intersections
(``intersection.py``), rays of an aberrated lens (``aberrated_rays.py``), their sums
(``ray_accumulators.py``). Behind an aberrated lens, ``smooth_tiles.py`` renders the tiles that need no march;
with dispersion, ``channel_rays.py`` decides when one march serves all channels.

Imports ``simd``; ``highlights``, which is above, splats bright lights, and
:mod:`bokehnet.classical.rays_renderer` combines all.
"""
