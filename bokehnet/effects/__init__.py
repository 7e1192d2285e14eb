"""Effects of a camera on a picture other than blur: distortion, chromatic aberration, vignetting, grain.

A room of its own because it processes whole pictures; :mod:`bokehnet.optics` has the formulas.
"""

from bokehnet.arrays.viewport import Viewport
from bokehnet.deprecation import earlier_class
from bokehnet.effects.camera import CameraEffects
from bokehnet.effects.warp import Warp
from bokehnet.optics.aberrations.distortion import BrownConrady, DivisionModel
from bokehnet.optics.grain import Grain
from bokehnet.optics.vignette import Vignette

__all__ = ["BrownConrady", "CameraEffects", "DivisionModel", "Grain", "Viewport", "Vignette", "Warp"]

__getattr__ = earlier_class(__name__, globals())
