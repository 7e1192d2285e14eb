"""What a camera does to a picture beyond blurring it: distortion, fringes, vignettes, grain.

A room of its own because it works on whole pictures, of which :mod:`bokehnet.optics` has the formulas.
"""

from bokehnet.effects.camera import CameraEffects
from bokehnet.effects.view import View
from bokehnet.effects.warp import Warp
from bokehnet.optics.aberrations.distortion import BrownConrady, DivisionModel
from bokehnet.optics.grain import Grain
from bokehnet.optics.vignette import Vignette

__all__ = ["BrownConrady", "CameraEffects", "DivisionModel", "Grain", "View", "Vignette", "Warp"]
