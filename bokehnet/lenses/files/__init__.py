"""Readers for lens files of other programs: one module per format, and one common structure.

Input: a path, for :func:`import_lens` of :mod:`bokehnet.lenses.files.reading`. Output: a
:class:`bokehnet.lenses.prescription_file.Prescription` and notes on it. Open ``structure.py``
first: the content of a file, and its conversion to a prescription.
"""
