"""Benchmark of synthetic depth of field, independent of any renderer; see ``README.md``.

Scenes are drawn from seeds (``scenes``), made of simple surfaces (``surfaces``), and traced through a thin
lens (``tracing``). ``maps`` makes depth maps with the faults of real estimators, two of them by ``stereo``
matching, with the ``filters`` of maps. ``metrics`` are fixed;
``methods`` runs a command or a Python function; ``leaderboard`` and ``page`` show results.
"""

__all__ = ["VERSION"]

# Version of scenes, maps, truths and metrics: results of different versions are not comparable.
VERSION = 3
