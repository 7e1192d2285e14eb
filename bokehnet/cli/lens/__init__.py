"""``bokehnet lens``: reports, files of other programs, tables and fits.

Open first: ``command.py``.
"""
