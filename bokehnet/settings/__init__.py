"""Settings of a render: groups of fields with unit, range and default, each defined once.

In: keyword arguments, TOML files, presets and the options of the command line. Out: a frozen
:class:`~bokehnet.settings.settings.RenderSettings`. This package opens no picture and imports no engine.

Open first: ``fields.py`` (base class of groups), ``settings.py`` (all groups together), then the groups:
``scene_settings.py``, ``engine_settings.py``, ``look_settings.py``, ``light_settings.py``.
``presets/*.toml`` are the shipped looks.
"""
