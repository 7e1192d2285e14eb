"""Highlights: bright lights taken out of the layers and laid out whole, as images of the lens's PSF.

In: layers, aperture, optionally what the lens does beyond focusing. Out: layers without lights, the lights as
rows of numbers, and their PSF images added to a picture, each pixel as far as it sees the light.

Open first: ``lights.py``, which parts lights from the rest and adds them again. Then ``psf_images.py``
(perfect lens) and ``aberrated_psf.py`` with ``ray_polynomials.py`` (real lens): what part of a light falls on
each pixel; ``psf_splatting.py`` adds these images, occluded by what stands in front.

Which pixels are lights at all is told by :mod:`bokehnet.classical.highlight_detection`. That file stands
below the rooms because ``layered`` asks it too: lights are not carried on into an occluded background. So
this room imports ``layered`` and ``layered`` never this one.
"""
