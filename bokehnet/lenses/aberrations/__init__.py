"""Aberrations of a lens: fitted aberration maps, point spread functions, wavefronts, relative illumination.

Input: a :class:`~bokehnet.lenses.prescription.PrescriptionLens`. Output: the data that renderers use.

Open first: ``aberration_fit.py``.
"""
