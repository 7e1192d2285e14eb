"""From a scene and settings to the picture: the renderer that people call, and its steps.

In: a :class:`~bokehnet.scene.scene.Scene` and :class:`~bokehnet.settings.settings.RenderSettings`. Out: a
:class:`~bokehnet.render.result.RenderResult` with the picture, the maps behind it and what was decided.

Open first: ``renderer.py``, then its steps in order: ``preparation.py`` (map repaired, focus set),
``look.py`` (aperture, lens, effects from settings), ``exposure.py`` (blur and effects), ``result.py``.
"""
