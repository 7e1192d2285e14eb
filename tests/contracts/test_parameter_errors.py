"""Whatever a field is given, only errors of the package come, and they name the field."""

import copy
import dataclasses
import math

import numpy as np
import pytest

from bokehnet.effects import BrownConrady, CameraEffects, DivisionModel, Grain, Viewport, Vignette, Warp
from bokehnet.errors import BokehnetError, LensError, ParameterError
from bokehnet.lenses import ThinLens
from bokehnet.lenses.thick import ThickLens
from bokehnet.lenses.tilt_shift import TiltShift
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.focus_plane import FocusPlane
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.optics.tone import Highlights

THIN = ThinLens(focal_length=50.0, f_number=2.0)

GOOD = [
    Aperture(),
    Highlights(),
    Vignette(stops=1.0),
    Grain(iso=100.0),
    CameraEffects(),
    Warp(),
    DivisionModel(strength=0.1),
    BrownConrady(),
    AberrationSliders(),
    ChromaticAberration(),
    WavelengthSampling(),
    LensResponse(),
    FocusPlane(level=0.5),
    AberrationMap.perfect(),
    Viewport(width=4, height=3),
    THIN,
    ThickLens(focal_length=50.0, f_number=2.0),
]

# No field takes one of these.
NEVER = [
    "wide",
    "",
    object(),
    {},
    b"1",
    1j,
    math.nan,
    -math.inf,
    np.nan,
    np.array([[math.nan]]),
    (math.nan, math.inf),
    [[0.5], "x"],
    (None, None),
    -(10**400),
]

# What some fields take.
TAKEN = {
    None: ("picture", "distortion", "vignette", "grain", "chromatic_aberration"),
    True: ("monochrome",),
    math.inf: ("focus_distance",),
}

# A number that is too large, and one too small, for fields that have a range.
BEYOND = {
    Aperture: {
        "blades": (17, -1),
        "curvature": (1.1, -0.1),
        "squeeze": (11, 0),
        "cats_eye": (1.6, -0.1),
        "spherical_profile": (1.1, -1.1),
        "obstruction": (0.96, -0.1),
        "onion": (1.1, -0.1),
        "onion_rings": (41, 0),
        "grain": (1.1, -0.1),
        "grain_seed": (0.5, -1),
        "picture": (np.full((3, 3), math.inf), -np.ones((3, 3))),
    },
    Highlights: {"threshold": (1.0, -0.1), "gain": (math.inf, 0.9)},
    Vignette: {"stops": (11, -11), "radius": (3, -1), "softness": (3, 0), "roundness": (2, -1)},
    Grain: {
        "iso": (math.inf, 0),
        "size": (51, -1),
        "seed": (0.5, -1),
        "full_well": (math.inf, 0),
        "read_noise": (math.inf, 0),
    },
    CameraEffects: {
        "lateral": (0.2, -0.2),
        "cos4": (81, -1),
        "optical_vignetting": (1.6, -0.1),
        "shading": ((1.0,), (1.0, 0.0)),
    },
    Warp: {"lateral": (0.2, -0.2)},
    DivisionModel: {"strength": (0.91, -0.91)},
    BrownConrady: {"radial": ((0.0,) * 4, ()), "decentring": ((0.0,) * 3, (0.0, math.inf))},
    AberrationSliders: dict.fromkeys(("spherical", "coma", "astigmatism", "field_curvature"), (101, -101)),
    ChromaticAberration: dict.fromkeys(("axial", "lateral"), (101, -101)),
    WavelengthSampling: {"equaliser": ((1.0,) * 65, ()), "dispersion": ("prism", ["rgb"])},
    FocusPlane: {"slope": ((0.0,) * 3, ())},
    Viewport: {"width": (4.5, 0), "height": (4.5, 0), "left": (0.5, 0.1), "top": (0.5, 0.1)},
    AberrationMap: {"tilt": ((0.0,) * 3, ()), "vignetting_apertures": (((0.1, 0.0),), ((0.1,),))},
    ThinLens: {"focal_length": (math.inf, 0), "f_number": (math.inf, 0), "focus_distance": (50, -1)},
    ThickLens: {"focal_length": (math.inf, 0), "f_number": (math.inf, 0), "focus_distance": (50, -1)},
}


def cases():
    for good in GOOD:
        for field in dataclasses.fields(good):
            if not field.init:
                continue
            values = [*NEVER, *(value for value, names in TAKEN.items() if field.name not in names)]
            values += BEYOND.get(type(good), {}).get(field.name, ())
            yield pytest.param(good, field.name, values, id=f"{type(good).__name__}-{field.name}")


@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
@pytest.mark.parametrize(("good", "name", "values"), cases())
def test_errors_of_wrong_values_name_their_field(good, name, values):
    for value in values:
        with pytest.raises(BokehnetError) as caught:
            dataclasses.replace(good, **{name: value})
        error = caught.value
        if isinstance(error, ParameterError | LensError):
            assert error.parameter == name, repr(value)
        else:
            assert name in str(error), repr(value)
        assert "\n" not in str(error), repr(value)
        if isinstance(error, ParameterError):
            assert error.expected, repr(value)
            assert str(error).startswith(f"{name}: expected "), repr(value)
            assert str(copy.copy(error)) == str(error), repr(value)


@pytest.mark.parametrize(
    "name", [field.name for field in dataclasses.fields(TiltShift) if field.name != "lens"]
)
def test_errors_of_a_tilted_sensor_name_their_field(name):
    for value in ("wide", None, math.nan, math.inf, (), (None, 1.0), (math.nan, 0.0), True, 1j):
        with pytest.raises(LensError) as caught:
            TiltShift(lens=THIN, **{name: value})
        assert caught.value.parameter == name, repr(value)


@pytest.mark.parametrize("kind", [float, int, np.float32, np.int64, np.array])
def test_numbers_of_all_kinds_are_taken(kind):
    assert Highlights(gain=kind(2)).gain == 2
    assert Aperture(curvature=kind(1)).curvature == 1
    assert ThinLens(focal_length=kind(50), f_number=kind(2)).pupil_radius == 12.5
    assert Vignette(stops=kind(1)).stops == 1
    assert Grain(iso=kind(100)).white == 50000


def test_tensors_without_dimensions_are_taken():
    torch = pytest.importorskip("torch")
    number = torch.tensor(0.05, requires_grad=True)
    assert CameraEffects(lateral=number, cos4=number).lateral is number
    assert DivisionModel(strength=number).strength is number
    with pytest.raises(ParameterError, match=r"^strength: expected -0\.9 to 0\.9, got 2$"):
        DivisionModel(strength=torch.tensor(2.0))
    with pytest.raises(ParameterError, match=r"^stops: expected -10 to 10, got an array of shape \(2,\)$"):
        Vignette(stops=torch.zeros(2))
