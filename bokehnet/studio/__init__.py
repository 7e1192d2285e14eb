"""The studio: a page in the browser, served from this machine to this machine, on which one plays with bokeh.

In goes a picture with whatever tells its depth, opened by :func:`bokehnet.scene.scene.read_scene`, and
changes of :class:`~bokehnet.settings.settings.RenderSettings`. Out come previews, quick ones first, and
files whose bytes are those of the command line that the page shows. It knows the public room and how to draw;
nothing of the field.

Open first: ``session.py`` (what is open), ``preview.py`` (from a change to pixels), ``app.py`` (what the page
can ask for), ``guard.py`` (who may ask).
"""
