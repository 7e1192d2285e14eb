"""The public room: from what the user has to the picture.

In goes what people have: a picture, whatever tells its depth (:mod:`~bokehnet.rendering.depth_source`), and
:class:`~bokehnet.rendering.settings.RenderSettings`. Out comes a
:class:`~bokehnet.rendering.result.RenderResult`: the blurred picture, the maps behind it, and what was
decided on the way. All of it works on NumPy arrays; files are opened by :mod:`bokehnet.io` alone, nothing is
printed, and long work tells its progress and can be cancelled. The command line and every other face stand
on this room and know nothing of the field themselves.

Open first: ``settings.py`` (what can be asked for), ``scene.py`` (what is given), ``renderer.py`` (the way).
"""
