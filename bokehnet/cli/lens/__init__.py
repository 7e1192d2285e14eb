"""``bokehnet lens``: reports, import of lens files, tables and fits.

Open first: ``command.py``.
"""
