"""Preview of the studio: progressive renders, overlays, and their conversion to bytes for a canvas.

Open first: ``preview.py``.
"""
