"""Aberrations of a lens: maps fitted to traced rays, point-spread functions, wave-fronts, light fall-off.

In: a :class:`~bokehnet.lenses.prescription.PrescriptionLens`. Out: what renderers take of it.

Open first: ``aberration_fit.py``.
"""
