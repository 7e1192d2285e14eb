"""Exposure of a focused scene: blur by a lens, light of lamps, memory bounds, supersampling.

In: a focused scene, render settings. Out: the blurred picture with its maps. Open first: ``exposure.py``.
"""
