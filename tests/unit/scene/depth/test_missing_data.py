"""Pixels without data: what counts as such, and how they are filled."""

import numpy as np
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.scene.depth.hole_filling import fill_holes
from bokehnet.scene.depth.missing_data import filled_map, find_missing_depth, find_missing_disparity

RNG = np.random.default_rng(3)
HEIGHT, WIDTH = 120, 160
Y, X = np.mgrid[:HEIGHT, :WIDTH]
DISC = (X - 80) ** 2 + (Y - 60) ** 2 < 32**2
DEPTH = np.where(DISC, 1500.0 + Y, 4000.0 + 5 * X).astype(np.float32)  # mm
IMAGE = (
    np.where(DISC[..., None], [0.6, 0.3, 0.2], [0.2, 0.35, 0.5]) + 0.02 * RNG.random((HEIGHT, WIDTH, 3))
).astype(np.float32)


def depth_mask(numbers, largest=65535, is_disparity=False, no_data=None):
    numbers = np.asarray(numbers, np.float32)
    return find_missing_depth(numbers, largest, is_disparity=is_disparity, no_data=no_data).mask


def disparity_mask(numbers, largest=65535, invert=False, no_data=None):
    numbers = np.asarray(numbers, np.float32)
    return find_missing_disparity(numbers, largest, invert=invert, no_data=no_data).mask


@pytest.mark.parametrize("sentinel", [0, -1, np.nan, -np.inf, 65535])
def test_sentinels_of_depth(sentinel):
    holes = RNG.random(DEPTH.shape) < 0.1
    assert (depth_mask(np.where(holes, sentinel, DEPTH)) == holes).all()


def test_infinite_depth_and_far_areas_at_the_top_are_sky():
    assert not depth_mask(np.where(Y < 30, np.inf, DEPTH)).any()
    assert not depth_mask(np.where(Y < 30, 65535, DEPTH)).any()
    assert not depth_mask(np.linspace(60000, 65535, DEPTH.size).reshape(DEPTH.shape)).any()


def test_zero_metric_disparity_is_sky_unless_the_map_is_sparse():
    disparity = 1000 / DEPTH
    assert not depth_mask(np.where(Y < 30, 0, disparity), None, is_disparity=True).any()
    sparse = (Y % 4 > 0) | (X % 3 > 0)
    assert (depth_mask(np.where(sparse, 0, disparity), None, is_disparity=True) == sparse).all()


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize("fraction", [0.02, 0.2, 1 / 3])
def test_sparse_maps_have_data_where_they_are_not_zero(invert, fraction):
    """LiDAR and structure from motion: single pixels with data, in any coding."""
    sparse = RNG.random(DEPTH.shape) >= 0.75 * fraction
    assert (disparity_mask(np.where(sparse, 0, DEPTH), invert=invert) == sparse).all()
    assert (disparity_mask(np.where(sparse, 0, DEPTH / DEPTH.max()), None, invert=invert) == sparse).all()


def test_holes_of_a_depth_camera_read_as_inverted_disparity():
    holes = (RNG.random(DEPTH.shape) < 0.03) | ((X > 110) & (X < 118) & (Y > 30) & (Y < 90))
    assert (disparity_mask(np.where(holes, 0, DEPTH), invert=True) == holes).all()


def test_the_largest_count_of_a_depth_camera_is_no_data_under_inversion():
    """Authority: the mask of the holes. Sky, walls at the far plane and maps of 8 bits keep their values."""
    holes = (RNG.random(DEPTH.shape) < 0.03) | ((X > 110) & (X < 112) & (Y > 30) & (Y < 90))
    assert (disparity_mask(np.where(holes, 65535, DEPTH), invert=True) == holes).all()
    assert not disparity_mask(np.where(holes, 65535, DEPTH), invert=False).any()
    assert not disparity_mask(np.where(holes, 65535, DEPTH), invert=True, no_data=7).any()
    assert not disparity_mask(np.where(holes, 65535, 8 * DEPTH), invert=True).any()  # normalised, a far net
    assert not disparity_mask(np.where(holes, 255, DEPTH / 40), 255, invert=True).any()
    for far, depth in ((DISC, DEPTH), (holes, 8 * DEPTH)):
        values = np.where(far, 65535, depth).astype(np.float32)
        found = find_missing_disparity(values, 65535, invert=True, no_data=None)
        assert not found.mask.any()
        assert f"{far.sum()} pixels of the map are 65535 and count as farthest" in found.notes[0]
    sky = np.where(Y < 30, 65535, DEPTH).astype(np.float32)
    assert not find_missing_disparity(sky, 65535, invert=True, no_data=None).notes


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize(
    "values",
    [
        np.where(DISC, 65535, 0),  # two levels, as drawn by hand
        np.where(DISC, 0, 65535),
        np.where((X % 16 == 8) | (Y % 16 == 8), 65535, 0),  # wires before the farthest plane
        65535 * (X / (WIDTH - 1)),
    ],
)
def test_zeros_of_normalised_maps_are_data(values, invert):
    assert not disparity_mask(values, invert=invert).any()
    assert not disparity_mask(values / 65535, None, invert=invert).any()


def test_a_far_plane_of_zeros_is_data():
    assert not disparity_mask(np.where(DISC, 30000, 0)).any()


def test_doubtful_zeros_are_reported_with_invert():
    result = find_missing_disparity(np.where(DISC, 0, 1).astype(np.float32), None, invert=True, no_data=None)
    assert not result.mask.any()
    assert f"{DISC.sum()} pixels of the map are 0 and count as nearest" in result.notes[0]


def test_a_named_number_is_no_data():
    values = np.where(DISC, 30000, 7)
    assert (disparity_mask(values, no_data=7) == ~DISC).all()
    assert (depth_mask(values, no_data=7) == ~DISC).all()


def test_negative_disparity_is_data_unless_it_is_a_sentinel():
    pixels = 5 + 0.1 * X
    assert (disparity_mask(np.where(DISC, -1, pixels), None) == DISC).all()
    assert (disparity_mask(np.where(DISC, -9999, pixels), None) == DISC).all()
    assert not disparity_mask(np.where(DISC, -1, 1.0), None).any()
    assert not disparity_mask(np.linspace(-1, 5, DISC.size).reshape(DISC.shape), None).any()


@pytest.mark.parametrize(
    "known",
    [
        (Y % 4 == 0) & (X % 3 == 0),
        RNG.random((HEIGHT, WIDTH)) < 0.05,
        (Y % 8 == 0) & (RNG.random((HEIGHT, WIDTH)) < 0.5),  # lines of a LiDAR
        RNG.random((HEIGHT, WIDTH)) > 0.2,
        DISC | ((X - 74) ** 2 + (Y - 60) ** 2 >= 32**2),  # shadow of a stereo pair beside the disc
    ],
)
def test_holes_are_filled_along_the_surfaces_of_the_picture(known):
    """Authority: the map before the holes. By distance alone, 0.2 % to 1 % lie on the wrong surface."""
    true = (1000 / DEPTH).astype(np.float32)
    filled = fill_holes(np.where(known, true, np.nan).astype(np.float32), IMAGE)
    assert (filled[known] == true[known]).all()
    step = float(np.ptp(true))
    assert np.mean(np.abs(filled - true) > 0.2 * step) < 5e-4
    assert np.abs(filled - true).mean() < 0.01 * step


def test_a_slope_is_interpolated():
    """Authority: the formula of the slope; Laplace's equation reproduces it between its values."""
    true = (0.2 + 0.002 * X + 0.003 * Y).astype(np.float32)
    known = ((Y % 5 == 0) & (X % 5 == 0)) | (X == 0) | (X == WIDTH - 1) | (Y == 0) | (Y == HEIGHT - 1)
    filled = fill_holes(np.where(known, true, np.nan).astype(np.float32))
    assert np.abs(filled - true).max() < 0.002


def test_filling_is_reported_with_count_kind_and_position_or_refused():
    numbers = DEPTH.copy()
    numbers[5, 7], numbers[9, 3] = 0, np.nan
    missing = find_missing_depth(numbers, None, is_disparity=False, no_data=None)
    values = np.where(missing.mask, np.nan, 1 / DEPTH).astype(np.float32)
    _, reading, notes = filled_map(values, missing, IMAGE, "fill", "z.png")
    assert reading == ("0.01 % of the map without data filled",)
    assert notes[0].startswith("z.png: no data at 2 pixels (0.01 %: 1 NaN, 1 0), first at x=7, y=5; filled")
    with pytest.raises(ImageFileError, match=r"no data at 2 pixels.*`depth.holes` fill"):
        filled_map(values, missing, IMAGE, "error", "z.png")
    with pytest.raises(ImageFileError, match="the map is empty"):
        filled_map(np.full_like(values, np.nan), missing, IMAGE, "fill", "z.png")


def test_a_large_map_has_the_least_and_the_following_number_of_all_its_blocks_of_rows():
    """Rows are read in blocks: only the last block has the sentinel, only the first the smallest data."""
    numbers = np.full((1200, 900), 40, np.float32)
    numbers[0, 0], numbers[0, 1], numbers[-1, 5], numbers[600, 7] = 0.5, 900, -1, np.inf
    missing = find_missing_disparity(numbers, None, invert=False, no_data=None)
    assert np.argwhere(missing.mask).tolist() == [[600, 7], [1199, 5]]
    assert missing.counts == {"NaN": 0, "infinite": 1, "-1": 1}
    numbers[1, 1] = -3  # a second negative number: no sentinel
    assert not find_missing_disparity(numbers, None, invert=False, no_data=None).mask[-1, 5]
