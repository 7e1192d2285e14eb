"""Scene of a render: picture, depth, camera and focus, before any blur.

In: a picture and a depth source (``depth/``), from files or arrays, and the settings of the scene. Out: a
:class:`~bokehnet.scene.scene.Scene`, and with the focus set a :class:`~bokehnet.scene.scene.FocusedScene`
with the signed defocus in pixels.

Open first: ``scene.py``, ``depth/depth_source.py``, ``focus.py``, ``preparation/preparation.py``.
"""
