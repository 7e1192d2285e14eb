"""Previewer of 3-D scene files: orbit, focus and lens in the browser, with drafts and traced pictures.

Open first: ``app.py``.
"""
