"""Preparation of a scene before the blur: depth repair, recovered light, focus.

In: a :class:`~bokehnet.scene.scene.Scene` and the settings of a render. Out: a
:class:`~bokehnet.scene.scene.FocusedScene`. What depends on the picture alone is cached. Open first:
``preparation.py``.
"""
