import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.depth_repair.mixed_pixels import mixed_pixel_fraction, repair_mixed
from bokehnet.errors import ParameterError, ShapeError

NEAR, FAR = 1.0, 0.1  # 1/m


def edge(coverage, filtered, far=FAR, width=24):
    """Return a vertical edge, near on the left, with mixed pixels of some coverage between both sides."""
    row = np.concatenate([np.ones(width // 2), np.atleast_1d(coverage), np.zeros(width // 2)])
    row = 1 / (row / NEAR + (1 - row) / far) if filtered == "depth" else row * NEAR + (1 - row) * far
    return np.tile(row, (10, 1)).astype(np.float32)


@pytest.mark.parametrize("filtered", ["disparity", "depth"])
@pytest.mark.parametrize("coverage", [[0.2], [0.45], [0.55], [0.85], [0.75, 0.25], [0.9, 0.55, 0.2]])
def test_a_mixed_pixel_gets_the_value_of_the_side_with_more_coverage(filtered, coverage):
    """Formula: the quantity that was filtered is linear in coverage; the majority is the rounded coverage.

    Pixels that do not change are within a tenth of the edge height.
    """
    repaired = repair_mixed(edge(coverage, filtered), filtered=filtered)
    assert_allclose(repaired, edge(np.round(coverage), filtered), rtol=0, atol=0.1 * (NEAR - FAR))


@pytest.mark.parametrize("direction", ["row", "column", "diagonal"])
def test_edges_of_every_direction_are_repaired(direction):
    y, x = np.mgrid[:48, :48] / 2
    side = {"row": y - 12.25, "column": x - 12.25, "diagonal": x + y - 24.25}[direction]
    fine = np.where(side < 0, NEAR, FAR)
    mixed = fine.reshape(24, 2, 24, 2).mean((1, 3)).astype(np.float32)
    inner = repair_mixed(mixed)[1:-1, 1:-1]
    assert not set(np.unique(mixed)) <= {np.float32(NEAR), np.float32(FAR)}
    assert set(np.unique(inner)) <= {np.float32(NEAR), np.float32(FAR)}


def test_mixed_pixels_at_a_very_far_sky_are_repaired():
    """Depth mixed with a sky at 1e10 m is nearly sky in disparity at any coverage."""
    mixed = edge([0.8], "depth", far=1e-10)
    assert mixed[0, 12] < 1e-9
    assert_array_equal(repair_mixed(mixed, filtered="depth"), edge([1.0], "disparity", far=1e-10))


def test_mixed_pixels_at_an_infinitely_far_sky_are_repaired():
    """An average with infinity is infinite, so a finite value is a surface."""
    values = edge([0.8], "disparity", far=0.0)
    assert_array_equal(repair_mixed(values, filtered="depth"), values)
    assert_array_equal(repair_mixed(values), edge([1.0], "disparity", far=0.0))


@pytest.mark.parametrize("filtered", ["disparity", "depth"])
def test_slopes_do_not_change(filtered):
    y, x = np.mgrid[:40, :60]
    for slope in (0.001 * x + 0.2, 0.02 * x + 0.01 * y + 0.1, 0.1 + 0.9 / (1 + 0.2 * x)):
        values = slope.astype(np.float32)
        assert_array_equal(repair_mixed(values, filtered=filtered), values)


def test_round_objects_hardly_change():
    """The surface of a ball recedes at its silhouette within one or two pixels."""
    y, x = np.mgrid[:64, :64] - 31.5
    ball = 0.5 + 0.3 * np.sqrt(np.clip(1 - (x**2 + y**2) / 24**2, 0, None))
    values = np.where(x**2 + y**2 < 24**2, ball, 0.3).astype(np.float32)
    assert np.abs(repair_mixed(values) - values).max() < 0.1
    assert (repair_mixed(values) != values).mean() < 0.005


@pytest.mark.parametrize("width", [1, 2, 3])
def test_thin_structures_do_not_change(width):
    for value in (NEAR, 0.6, FAR / 2):
        values = np.full((20, 30), 0.3, np.float32)
        values[:, 12 : 12 + width] = value
        assert_array_equal(repair_mixed(values), values)


def test_a_surface_of_two_pixels_between_near_and_far_does_not_change():
    values = edge([0.5, 0.5], "disparity")
    assert_array_equal(repair_mixed(values), values)


def test_wide_ramps_do_not_change():
    values = edge(np.linspace(0.9, 0.1, 8), "disparity")
    assert_array_equal(repair_mixed(values), values)


def test_every_value_occurs_in_the_input():
    values = np.random.default_rng(0).random((30, 40)).astype(np.float32)
    repaired = repair_mixed(values)
    assert repaired.shape == values.shape
    assert np.isin(repaired, values).all()


def test_the_mixed_fraction_separates_filtered_maps_from_others():
    y, x = np.mgrid[:240, :240] / 4
    fine = np.where((x - 30) ** 2 + (y - 30) ** 2 < 20**2, NEAR, FAR + 0.001 * y)
    at_centres = fine[2::4, 2::4].astype(np.float32)
    filtered = fine.reshape(60, 4, 60, 4).mean((1, 3)).astype(np.float32)
    assert mixed_pixel_fraction(at_centres) < 0.02
    assert mixed_pixel_fraction(filtered) > 0.15
    assert mixed_pixel_fraction(np.ones((5, 5), np.float32)) == 0


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_small_maps_keep_their_shape(shape):
    values = np.linspace(0, 1, shape[0] * shape[1]).reshape(shape).astype(np.float32)
    assert repair_mixed(values).shape == shape


def test_wrong_arguments_raise_errors():
    with pytest.raises(ShapeError):
        repair_mixed(np.zeros((2, 2, 3), np.float32))
    with pytest.raises(ParameterError, match="NaN or infin"):
        repair_mixed(np.array([[1.0, np.inf]], np.float32))
    with pytest.raises(ParameterError, match="filtered"):
        repair_mixed(np.zeros((2, 2), np.float32), filtered="z")


def test_renders_of_repaired_depth_are_closer_to_the_truth():
    """Oracle: the same scene rendered from its true disparity at four times the resolution."""
    from bokehnet.render.renderer import BokehRenderer

    y, x = np.mgrid[:320, :400] / 4
    near = ((x - 35) ** 2 + (y - 40) ** 2 < 22**2) | (np.abs(x - 78 + 0.2 * y) < 3)
    disparity = np.where(near, 1.0, 0.02)
    texture = 0.5 + 0.5 * np.sin(0.7 * x + 0.3 * y)
    colours = np.where(near[..., None], [0.9, 0.5, 0.2], [0.1, 0.3, 0.6]) * (0.4 + 0.6 * texture[..., None])

    def shrink(values):
        return values.reshape(80, 4, 100, 4, *values.shape[2:]).mean((1, 3)).astype(np.float32)

    image, mixed = shrink(colours), (1 / shrink(1 / disparity)).astype(np.float32)
    renderer = BokehRenderer("rays")
    truth = shrink(
        renderer.render_arrays(colours.astype(np.float32), (32 * (disparity - 0.5)).astype(np.float32)).bokeh
    )

    def error(values):
        bokeh = renderer.render_arrays(image, 8 * (values - np.float32(0.5))).bokeh
        return -10 * np.log10(np.mean((bokeh - truth) ** 2))

    repaired = repair_mixed(mixed, filtered="depth")
    assert error(repaired) > error(mixed) + 1
    assert error(repaired) > error((disparity[2::4, 2::4]).astype(np.float32)) - 1
