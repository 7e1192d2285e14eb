"""Tools built on the renderer: comparison of engines, the demo, contact sheets, a look fitted to a pair.

In: scenes, settings, lenses. Out: sheets, scores and figures. Nothing below imports this package.

Open first: ``comparison.py``.
"""
