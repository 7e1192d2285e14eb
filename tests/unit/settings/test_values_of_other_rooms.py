"""Ranges and choices of the settings are those of the rooms that use them."""

import math
import typing

import numpy as np
import pytest

from bokehnet.depth_repair.repair import REPAIR_MODES
from bokehnet.effects import BrownConrady, CameraEffects, DivisionModel, Grain, Vignette
from bokehnet.engine_registry import ENGINES
from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.io.color.camera_spaces import INPUT_COLOR_SPACES
from bokehnet.io.depth.false_colors import COLOR_MAPS
from bokehnet.io.depth.packed_depth import PACKED_CODINGS
from bokehnet.io.depth.units import DEPTH_UNITS
from bokehnet.io.formats.output_format import COLOR_SPACE_NAMES, SUBSAMPLINGS, Bits
from bokehnet.lenses import ThinLens
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.focus_plane import check_tilt
from bokehnet.optics.spectral.coating import COATINGS
from bokehnet.optics.spectral.wavelength_sampling import DISPERSIONS, WavelengthSampling
from bokehnet.optics.tone import Highlights, gamma_curve
from bokehnet.settings.settings import all_settings

# What other rooms make of the fields.
BELOW = {
    "aperture.blades": lambda v: Aperture(blades=v),
    "aperture.curvature": lambda v: Aperture(blades=5, curvature=v),
    "aperture.rotation": lambda v: Aperture(blades=5, rotation=v),
    "aperture.squeeze": lambda v: Aperture(squeeze=v),
    "aperture.cats_eye": lambda v: Aperture(cats_eye=v),
    "aperture.spherical_profile": lambda v: Aperture(spherical_profile=v),
    "aperture.obstruction": lambda v: Aperture(obstruction=v),
    "aperture.onion": lambda v: Aperture(onion=v),
    "aperture.onion_rings": lambda v: Aperture(onion=1, onion_rings=v),
    "aperture.grain": lambda v: Aperture(grain=v),
    "aperture.grain_seed": lambda v: Aperture(grain=1, grain_seed=v),
    "lens.spherical": lambda v: AberrationSliders(spherical=v),
    "lens.coma": lambda v: AberrationSliders(coma=v),
    "lens.astigmatism": lambda v: AberrationSliders(astigmatism=v),
    "lens.field_curvature": lambda v: AberrationSliders(field_curvature=v),
    "color.axial": lambda v: ChromaticAberration(axial=v),
    "color.lateral": lambda v: ChromaticAberration(lateral=v),
    "color.dispersion": lambda v: WavelengthSampling(dispersion=v),
    "highlights.threshold": lambda v: Highlights(threshold=v),
    "highlights.gain": lambda v: Highlights(gain=v),
    "highlights.gamma": lambda v: gamma_curve(np.ones((2, 2, 3), np.float32), v),
    "effects.distortion": lambda v: DivisionModel(strength=v),
    "effects.brown": lambda v: BrownConrady(radial=(*v, 0.0, 0.0)),
    "effects.cos4": lambda v: CameraEffects(cos4=v),
    "effects.optical_vignetting": lambda v: CameraEffects(optical_vignetting=v),
    "effects.vignette": lambda v: Vignette(stops=v),
    "effects.vignette_radius": lambda v: Vignette(stops=1, radius=v),
    "effects.vignette_softness": lambda v: Vignette(stops=1, softness=v),
    "effects.vignette_roundness": lambda v: Vignette(stops=1, roundness=v),
    "effects.vignette_color_loss": lambda v: Vignette(stops=1, color_loss=v),
    "effects.grain": lambda v: Grain(iso=v) if v != 0 else None,
    "effects.grain_size": lambda v: Grain(iso=100, size=v),
    "effects.grain_mono": lambda v: Grain(iso=100, monochrome=v),
    "effects.grain_seed": lambda v: Grain(iso=100, seed=v),
    "focus.tilt_x": lambda v: check_tilt((v, 0.0)),
    "focus.tilt_y": lambda v: check_tilt((0.0, v)),
    "camera.focal_length": lambda v: ThinLens(focal_length=v, f_number=2),
    "camera.f_number": lambda v: ThinLens(focal_length=50, f_number=v),
}


def probes(known):
    """Values at, beside and far off the bounds of a field."""
    bounds = [one for one in (known.low, known.high, known.above, known.below) if one is not None]
    near = [float(np.nextafter(one, way)) for one in bounds for way in (-math.inf, math.inf)]
    numbers = [*bounds, *near, *(one - 1 for one in bounds), *(one + 1 for one in bounds)]
    if known.type is int:
        numbers = [int(one) for one in (*bounds, 0, 1, 2, 3, 16, 17, -1, 2**40)]
    numbers += [0, 0.5, 1e9, -1e9, math.nan, math.inf, -math.inf, True, False, None, "wide", [], 10**400, 1j]
    return [(one,) for one in numbers] if known.path == "effects.brown" else [*numbers, *DISPERSIONS]


@pytest.mark.parametrize("path", BELOW)
def test_ranges_agree_with_those_of_the_rooms_below(path):
    """Both ways, but that the settings also refuse whole numbers that are written as 5.0."""
    known = all_settings()[path]
    selected = 0
    for value in probes(known):
        if value is None and known.default is None:
            continue
        try:
            fitted = known.checked(value)
        except ParameterError:
            fitted = None
        if fitted is not None:
            BELOW[path](fitted)  # raises where the settings let too much pass
            selected += 1
        elif known.type is float and isinstance(value, float) and math.isfinite(value):
            with pytest.raises(BokehnetError):  # the settings refuse nothing of use
                BELOW[path](value)
        try:
            BELOW[path](value)
        except BokehnetError:
            assert fitted is None
    assert selected >= 2


def test_choices_are_those_of_the_rooms_below():
    choices = {path: set(known.choices) for path, known in all_settings().items() if known.choices}
    assert choices == {
        "depth.kind": {"planar", "ray", "zbuffer"},
        "depth.holes": {"fill", "error"},
        "input.color_space": {"auto", *INPUT_COLOR_SPACES},
        "input.projection": {"flat", "equirect"},
        "input.stereo": {"side-by-side", "top-bottom"},
        "light.ghosts": set(COATINGS),
        "depth.mixed": set(REPAIR_MODES),
        "depth.repair": set(REPAIR_MODES),
        "lens.aberrations": {"traced", "seidel"},
        "lens.engine": {"map", "profile"},
        "lens.focusing": {"sharpest", "paraxial"},
        "color.dispersion": set(DISPERSIONS),
        "engine.name": {*ENGINES},
        "engine.device": {"cpu", "cuda", "auto"},
        "output.color_space": set(COLOR_SPACE_NAMES),
        "output.bits": set(map(str, typing.get_args(Bits))),
        "output.subsampling": set(SUBSAMPLINGS),
        "output.dither": {"on", "off"},
        "output.shoulder": {"on", "off"},
        "output.expected_error": {"on", "off"},
    }


def test_codings_and_units_are_those_of_the_rooms_below():
    for coding in ("auto", "grey", *COLOR_MAPS, *PACKED_CODINGS):
        assert all_settings()["depth.coding"].checked(coding) == coding
    for unit in DEPTH_UNITS:
        assert all_settings()["depth.unit"].checked(unit) == unit
    for path, wrong in (("depth.coding", "cividis"), ("depth.unit", "km"), ("depth.unit", "0mm")):
        with pytest.raises(ParameterError, match=path):
            all_settings()[path].checked(wrong)
