"""Fit of aperture shape and colour aberrations to the blurred lamps of a photograph.

Input: a scene-linear picture with blurred lamps (:func:`find_discs` detects them). Output: values of the
aperture and colour settings, with uncertainties and the fitted discs.
"""
