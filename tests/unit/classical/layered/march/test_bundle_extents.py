"""Extents of bundles. Oracle: rays of the aberration map, one by one."""

import math

import numpy as np
import pytest

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.layered.march.aberrated_rays import lens_table
from bokehnet.classical.layered.march.bundle_extents import BUNDLE, LEVELS, bundle_extents, extent_at
from bokehnet.classical.rays_renderer import pupil_pattern
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture, pupil_points
from bokehnet.optics.sampling import sobol
from tests.unit.classical.aberrated_lenses import GLASS

SHAPE = (240, 320)
RIMMED = AberrationMap(
    wavelengths=GLASS.wavelengths,
    transverse_aberration=GLASS.transverse_aberration,
    pupil_aberration=GLASS.pupil_aberration,
    vignetting_apertures=((0.9, 1.0),),
    tilt=(0.1, -0.05),
)


@pytest.mark.parametrize("aberration_map", [GLASS, RIMMED], ids=["sliders", "rim and tilt"])
@pytest.mark.parametrize("defocus", [-2.0 * LEVELS, -20.3, 0.0, 9.7])
def test_no_ray_strays_farther_and_some_nearly_as_far(aberration_map, defocus):
    points, _, chances = pupil_pattern(Aperture())
    lens = lens_table(
        LensResponse(aberration_map=aberration_map), Viewport.whole(*SHAPE), chances, shape=SHAPE
    )
    extents = bundle_extents(points, lens)
    pupil, _ = pupil_points(Aperture(), sobol(BUNDLE, np.random.default_rng(5), 2), 1)
    for ring in (0, 15, len(extents) - 1):
        farthest = 0.0
        for angle in np.arange(8) * (math.pi / 4):
            field = ring / (len(extents) - 1) * np.array([math.cos(angle), math.sin(angle)])
            missed, run, passes = aberration_map(pupil, field)
            away = missed / lens.scale + defocus * run
            farthest = max(farthest, np.linalg.norm(away[passes], axis=-1).max())
        bound = extent_at(extents[ring], defocus)
        assert 0.85 * bound - 2.0 < farthest <= bound
