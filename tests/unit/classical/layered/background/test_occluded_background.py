"""Authority: scenes of two surfaces whose hidden part is known by construction."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from bokehnet.classical.layered.background.occluded_background import occluded_background
from bokehnet.errors import ParameterError, ShapeError


def scene(behind=-4.0, before=10.0):
    """A square before a plane whose red grows to the right."""
    image = np.zeros((48, 64, 3), np.float32)
    image[..., 0] = np.linspace(0, 1, 64)
    defocus = np.full((48, 64), behind, np.float32)
    inside = np.s_[16:32, 24:40]
    image[inside], defocus[inside] = (0, 1, 0), before
    return image, defocus, inside


def test_the_background_goes_on_behind_the_foreground():
    image, defocus, inside = scene()
    colors, depths = occluded_background(image, defocus)
    assert (depths[inside] == -4.0).all()
    assert not colors[inside][..., 1].any()
    left, right = colors[24, 25, 0], colors[24, 38, 0]
    assert abs(left - image[0, 23, 0]) < 0.05
    assert abs(right - image[0, 40, 0]) < 0.05


def test_of_two_things_the_one_that_counts_is_filled_as_both_would_be():
    image, defocus, inside = scene()
    image, defocus = (np.concatenate([x, x]) for x in (image, defocus))
    expected = np.zeros(defocus.shape, bool)
    expected[inside] = True
    both, one = occluded_background(image, defocus), occluded_background(image, defocus, inpainted=expected)
    for whole, part in zip(both, one, strict=True):
        np.testing.assert_array_equal(part[:48], whole[:48])
    assert np.abs(one[0][48:] - both[0][48:]).max() > 1e-3  # means, no lines


def test_what_no_ray_reaches_is_only_a_mean_of_its_surroundings():
    """A ray arrives no farther from its pixel than the blur radius of what it meets: 4 pixels."""
    image, defocus, _ = scene()
    image, defocus = (np.concatenate([x] * 3) for x in (image, defocus))
    rays_mask = np.zeros(defocus.shape, bool)
    rays_mask[:48] = True
    whole, seen = (
        occluded_background(image, defocus),
        occluded_background(image, defocus, rays_mask=rays_mask),
    )
    means = occluded_background(image, defocus, inpainted=rays_mask)
    np.testing.assert_array_equal(seen[0][:96], whole[0][:96])  # within 16 pixels: smaller layers read there
    np.testing.assert_array_equal(seen[0][96:], means[0][96:])
    assert np.abs(seen[0][96:] - whole[0][96:]).max() > 1e-3


def test_what_is_not_hidden_stays():
    image, defocus, inside = scene()
    colors, depths = occluded_background(image, defocus)
    outside = np.ones(defocus.shape, bool)
    outside[inside] = False
    np.testing.assert_array_equal(colors[outside], image[outside])
    np.testing.assert_array_equal(depths[outside], defocus[outside])


def test_it_reaches_as_far_as_rays_can_see():
    image, defocus, _ = scene(behind=-2.0, before=2.0)  # rays fall 4 pixels behind the edge
    _, depths = occluded_background(image, defocus)
    assert (depths[24, 24:28] == -2.0).all()
    assert (depths[23:25, 31:33] == 2.0).all()


def test_a_slope_hides_nothing():
    defocus = np.repeat(np.linspace(-20, 20, 64, dtype=np.float32)[None], 32, 0)
    image = np.random.default_rng(0).random((32, 64, 3), dtype=np.float32)
    colors, depths = occluded_background(image, defocus)
    np.testing.assert_array_equal(colors, image)
    np.testing.assert_array_equal(depths, defocus)


def test_each_side_of_a_thing_carries_on_its_own_background():
    image = np.zeros((9, 60, 3), np.float32)
    defocus = np.zeros((9, 60), np.float32)
    image[:, :30], image[:, 30:] = (1, 0, 0), (0, 0, 1)
    defocus[:, :30], defocus[:, 30:] = -8.0, -12.0
    image[:, 20:40], defocus[:, 20:40] = (0, 1, 0), 15.0
    colors, depths = occluded_background(image, defocus)
    np.testing.assert_allclose(colors[4, 22], (1, 0, 0))
    np.testing.assert_allclose(colors[4, 37], (0, 0, 1))
    assert depths[4, 22] == -8.0
    assert depths[4, 37] == -12.0


def test_bad_input_is_refused():
    image, defocus, _ = scene()
    with pytest.raises(ShapeError):
        occluded_background(image, defocus[:-1])
    with pytest.raises(ParameterError, match="defocus"):
        occluded_background(image, np.full_like(defocus, np.nan))


def test_lights_are_not_carried_on():
    image, defocus, inside = scene()
    image[...] = 0.1
    image[20:28, 22:24] = 50.0  # lamps that touch the square's left side
    colors, _ = occluded_background(image, defocus)
    assert colors[inside].max() < 5.0


def test_a_lamp_that_is_cut_is_no_beam_behind_what_cuts_it():
    """A disc of 81 pixels by night, cut by a bright wall, beside which it is no light."""
    rows, columns = np.mgrid[:64, :96]
    image = np.full((64, 96, 3), 0.01, np.float32)
    image[np.hypot(rows - 32, columns - 46) < 5] = 0.7
    image[:, 48:] = 0.4
    defocus = np.where(columns < 48, 0.0, 24.0).astype(np.float32)
    colors, _ = occluded_background(image, defocus)
    assert colors[24:41, 48].max() > 0.5
    assert np.count_nonzero(colors[:, 56:72, 0] > 0.3) < 40


def test_a_pole_behind_a_blade_of_grass_stays_a_pole():
    """A blade two pixels wide crosses a pole before a wall: both go on behind it."""
    image = np.full((30, 40, 3), (0.1, 0.2, 0.8), np.float32)
    defocus = np.full((30, 40), -9.0, np.float32)
    image[12:18], defocus[12:18] = (0.7, 0.7, 0.2), 0.0
    expected = image.copy(), defocus.copy()
    image[:, 20:22], defocus[:, 20:22] = (0.0, 1.0, 0.0), 6.0
    colors, depths = occluded_background(image, defocus)
    hidden = np.s_[4:26, 20:22]
    np.testing.assert_array_equal(np.abs(depths[hidden] - expected[1][hidden]) < 0.5, True)
    np.testing.assert_allclose(colors[hidden], expected[0][hidden], atol=0.01)


def test_what_is_hidden_goes_over_from_one_side_to_the_other():
    image = np.zeros((20, 30, 3), np.float32)
    image[:, :10], image[:, 20:] = 0.2, 0.8
    defocus = np.where((np.arange(30) >= 10) & (np.arange(30) < 20), 12.0, 0.0).astype(np.float32)
    colors, _ = occluded_background(image, np.repeat(defocus[None], 20, 0))
    row = colors[10, 8:22, 0]
    assert (np.diff(row) >= -1e-6).all()
    assert row[2:-2].min() < 0.3
    assert row[2:-2].max() > 0.7
    assert np.abs(np.diff(row)).max() < 0.35  # half of the guess is what looks alike on one side


def test_far_behind_the_edge_two_surfaces_blend_without_speckle():
    """A dark surface and a bright one behind a wide disc: each pixel selects one of them by its directions.

    Measure: pixels farther than 0.05 from the median of their 3x3 neighbours. Their own boundary outside the
    occluder is not looked at.
    """
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:360, :400]
    bright = x + 30 * np.sin(y / 9) > 200
    defocus = np.where(bright, 0.0, -12.0) + rng.normal(0, 0.4, bright.shape)
    image = np.where(bright, 0.8, 0.1)[..., None].repeat(3, 2).astype(np.float32)
    inside = np.s_[60:300, 80:320]
    defocus[inside] = 140.0
    colors, _ = occluded_background(image, defocus.astype(np.float32))
    far = colors[100:260, 120:280, 0]
    assert (np.abs(far - median_filter(far, 3)) > 0.05).mean() < 0.001
    assert far.std() > 0.1
