"""Previewer of 3-D scene files: orbit, focus and lens in the browser, with drafts and traced pictures.

Open first: ``app.py``.
"""

SCENE_SUFFIXES = (".toml", ".obj", ".ply", ".stl", ".glb", ".gltf")
"""Lower-case suffixes of files that open as a 3-D scene: scene files and meshes."""
