"""Tools built on the renderer: engine comparison, demo, contact sheets, and fitting a look to an image pair.

In: scenes, settings, lenses. Out: sheets, scores and figures. No lower layer imports this package.

Open first: ``comparison.py``.
"""
