"""Studio: a local web page for interactive rendering.

In: a picture with a depth source, opened by :func:`bokehnet.scene.scene.read_scene`, and changes of
:class:`~bokehnet.settings.settings.RenderSettings`. Out: previews, quick ones first, and files that are
byte-identical to those of the shown command line. The studio uses the public renderer and draws; it contains
no optics.

Open first: ``session.py`` (state), ``preview.py`` (changes to pixels), ``app.py`` (requests), ``guard.py``
(access control).
"""
