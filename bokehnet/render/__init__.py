"""Rendering of a scene by settings: the public renderer and its steps.

In: a :class:`~bokehnet.scene.scene.Scene` and :class:`~bokehnet.settings.settings.RenderSettings`. Out: a
:class:`~bokehnet.render.result.RenderResult` with the picture, the intermediate maps and a report.

Open first: ``renderer.py``, then its steps in order: ``scene/preparation`` (depth repair, focus),
``look.py`` (aperture, lens, effects from settings), ``exposure.py`` (blur and effects), ``result.py``.
"""
