"""Settings of a rendering: groups of fields with unit, range and default, each stated once.

In: keyword arguments, TOML files, presets and the options of the command line. Out: a frozen
:class:`~bokehnet.settings.settings.RenderSettings`. Nothing here opens a picture or knows an engine's code.

Open first: ``fields.py`` (what a group of fields is), ``settings.py`` (all groups together), then the groups:
``scene_settings.py``, ``look_settings.py``, ``light_settings.py``. ``presets/*.toml`` are the shipped looks.
"""
