"""Spreading with a profile texture against the traced image of a point on the axis."""

import math

import numpy as np
import pytest

from bokehnet.baselines.spread.profile_spreading import plane_of_blur, texture_spreading
from bokehnet.classical.rays_renderer import rays
from bokehnet.errors import ParameterError
from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import PsfGrid, correlation, traced_psf
from bokehnet.lenses.lookup.printed_mappings import circle_of_confusion
from bokehnet.lenses.lookup.profile_texture import profile_row, trace_profile_texture
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

LENS = load_lens("double_gauss", focus_distance=3000.0)
TEXTURE = trace_profile_texture(LENS)
PITCH = 0.03


@pytest.mark.parametrize("depth", [2200.0, 5000.0])
def test_the_plane_is_that_of_the_depth_with_this_blur(depth):
    """Authority: the mapping of depths, from the principal planes."""
    radius = float(LENS.coc_radius(1 / depth))
    for wavelength in (450.0, 587.6):
        plane = plane_of_blur(TEXTURE, LENS, radius, wavelength)
        assert plane == pytest.approx(profile_row(TEXTURE, LENS, depth, wavelength), abs=0.02)


@pytest.mark.parametrize("depth", [2200.0, 5000.0])
def test_a_light_on_the_axis_is_its_traced_image(depth):
    """Authority: rays through the glass."""
    radius = float(LENS.coc_radius(1 / depth)) / PITCH
    image = np.zeros((65, 65, 3), np.float32)
    image[32, 32] = 100.0
    result = texture_spreading(image, np.full((65, 65), radius, np.float32), TEXTURE, LENS, PITCH)
    wavelengths, colors = WavelengthSampling().sample(12)
    traced = traced_psf(
        LENS,
        PsfGrid(wavelengths=wavelengths, colors=colors, pitch=PITCH, size=65, rays=12000),
        depth=depth,
        field=(0.0, 0.0),
    )
    assert correlation(result, traced) > 0.95
    assert result.sum() == pytest.approx(300.0, rel=0.01)


@pytest.mark.slow
def test_rays_draw_the_lamp_of_the_axis_in_the_corner_too():
    """Authority: rays through the glass to the middle of the sensor, where the whole map has a cat's-eye."""
    height, width, depth, size = 129, 193, 1000.0, 41
    pitch = 36 / width
    image = np.zeros((height, width, 3), np.float32)
    image[24, 24] = 100.0
    defocus = np.full((height, width), float(LENS.coc_radius(1 / depth)) / pitch, np.float32)
    whole = fit_aberration_map(LENS, half_diagonal=pitch * math.hypot(height, width) / 2)
    wavelengths, colors = WavelengthSampling().sample(12)
    grid = PsfGrid(wavelengths=wavelengths, colors=colors, pitch=pitch, size=size, rays=12000)
    traced = traced_psf(LENS, grid, depth=depth, field=(0.0, 0.0))
    corner, axis = (
        rays(image, defocus, lens_response=LensResponse(aberration_map=each))[4 : 4 + size, 4 : 4 + size]
        for each in (whole, whole.on_axis())
    )
    assert correlation(axis, traced) > 0.99
    assert correlation(corner, traced) < 0.97


def test_a_pitch_of_zero_is_an_error():
    with pytest.raises(ParameterError, match="pixel_pitch"):
        texture_spreading(np.zeros((4, 4, 3)), np.zeros((4, 4)), TEXTURE, LENS, 0.0)


@pytest.mark.parametrize("depth", [2200.0, 5000.0])
def test_the_printed_plane_has_the_disc_of_the_thin_lens(depth):
    """Authority: (5.7), the disc on a sensor that is as far from the sharp image as the plane."""
    radius = float(LENS.coc_radius(1 / depth))
    sharpest = LENS.sensor_position - LENS.gaussian_focus
    plane = plane_of_blur(TEXTURE, LENS, radius, 587.6, "printed") - sharpest
    focal, focus, lens_radius = LENS.focal_length, LENS.focus_distance, float(LENS.thick.pupil_radius)
    image = focal * focus / (focus - focal)
    disc = circle_of_confusion(depth, focus, focal, lens_radius)
    # The recorded object, in focus at `image`, on a sensor at `image + plane`.
    assert lens_radius * plane / image == pytest.approx(disc, rel=0.02)


def test_the_printed_mapping_needs_a_finite_focus():
    lens = load_lens("double_gauss", focus_distance=np.inf)
    with pytest.raises(ParameterError, match=r"^lens: expected a lens with a finite focus"):
        texture_spreading(np.zeros((4, 4, 3)), np.zeros((4, 4)), TEXTURE, lens, 0.1, mapping="printed")
    with pytest.raises(ParameterError, match="mapping"):
        texture_spreading(np.zeros((4, 4, 3)), np.zeros((4, 4)), TEXTURE, LENS, 0.1, mapping="thin")
