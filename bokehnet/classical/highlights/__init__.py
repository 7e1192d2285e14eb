"""Highlights: bright lights removed from the layers and splatted whole, as images of the lens's PSF.

In: layers, aperture, optionally the aberrations of the lens. Out: layers without lights, the lights as
rows of values, and their PSF images added to a picture, each pixel by its visibility of the light.

Open first: ``lights.py``, which separates lights from the rest and adds them again. Then ``psf_images.py``
(perfect lens) and ``aberrated_psf.py`` with ``ray_polynomials.py`` (aberrated lens): fraction of a light on
each pixel; ``psf_splatting.py`` adds these images, occluded by nearer surfaces.

:mod:`bokehnet.classical.highlight_detection` detects lights. That file is below the rooms because ``layered``
uses it too: lights are not continued into an occluded background. This room imports ``layered``, and
``layered`` never imports this one.
"""
