"""Clipped light: the radiance that a display-referred photograph no longer stores.

In: a scene-linear picture decoded from stored values of 0 to 1, and a map in which near is large. Out: the
same picture with lamps, skies and windows as bright as their halos, edges and surroundings say
(:class:`~bokehnet.light.recovery.RecoveredLight`). Bright matter, which clips as well, stays unchanged.

Open first: ``recovery.py``. Then ``clip_level.py`` (histogram), ``lamps.py`` (small lights), ``areas.py``
(skies and windows), ``bright_picture.py`` and ``edges.py`` (what both measure), ``config.py`` (constants).
"""
