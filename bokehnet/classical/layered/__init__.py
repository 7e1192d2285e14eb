"""Layered rays: pupil rays marched through the picture as a stack of layers.

In: picture (H, W, 3), signed defocus in pixels (H, W), optionally what the lens does beyond focusing.
Out: layers with their occluded background, and for each pixel the light that its rays meet, with the
disocclusion weight beside it.

Open first: ``layers.py``, from a picture to layers; it builds on ``depth_discontinuities.py`` and
``occluded_background.py``, in which ``structure_transport.py`` carries lines on. Then ``ray_marching.py``,
the loop over pixels and rays: where rays can meet a surface (``defocus_bins.py``), what they meet
(``intersection.py``), how the rays of a real lens run (``aberrated_rays.py``), what they add up to
(``ray_accumulators.py``). Behind a real lens, ``smooth_tiles.py`` takes the tiles that need no march,
and where it parts colours, ``channel_rays.py`` tells when one march serves all of them.

Imports ``simd``; bright lights are laid out by ``highlights``, which stands above, and
:mod:`bokehnet.classical.rays_renderer` puts all together.
"""
