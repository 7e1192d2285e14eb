"""A look from a photograph: the shape of the opening and its colours, fitted to the discs of lamps.

In goes a scene-linear picture with blurred lamps (:func:`find_discs` looks for them), out comes what the
aperture and colour settings take, with uncertainties and the discs as they were fitted.
"""
