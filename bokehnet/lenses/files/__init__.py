"""Lens files of other programs: one file here for each format, and one structure that all are read into.

In goes a path, by :func:`import_lens` of :mod:`bokehnet.lenses.files.reading`; out comes a
:class:`bokehnet.lenses.prescription_file.Prescription` and what has to be said of it. Open ``structure.py``
first: what a file says, and how it becomes a prescription.
"""
