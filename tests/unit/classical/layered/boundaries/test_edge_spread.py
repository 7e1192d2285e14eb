"""Truth: edges at random places and angles, drawn through filters whose width is known."""

import numpy as np
import pytest

from bokehnet.classical.layered.boundaries.edge_spread import edge_widths, estimate_filter
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter


def bars(pixel_filter, noise=0.0, seed=0):
    """Tilted bars, (240, 240, 3): across each edge the integral of the filter, as if it were isotropic."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:240, :240].astype(float)
    light = np.full((240, 240), 0.1)
    for number in range(12):
        angle = rng.uniform(-0.5, 0.5) + np.pi / 2 * (number % 2)
        offset = rng.uniform(20, 220)
        across = (columns - 120) * np.cos(angle) + (rows - 120) * np.sin(angle) + 120 - offset
        inside = pixel_filter.cumulative(across + 6) - pixel_filter.cumulative(across - 6)
        light += (rng.uniform(0.3, 0.8) - light) * inside
    return np.repeat(light[..., None], 3, 2) + rng.normal(0, noise, (240, 240, 3))


@pytest.mark.parametrize("width", [1.8, 2.0, 2.8, 3.8])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_width_of_a_gaussian_is_found(width, noise):
    result = estimate_filter(bars(PixelFilter("gaussian", width), noise))
    assert result.pixel_filter.name == "gaussian"
    assert result.pixel_filter.width == pytest.approx(width, rel=0.1)
    assert result.confidence > 0.7


def test_the_filter_of_blender_is_seen_as_a_gaussian_of_its_weights():
    result = estimate_filter(bars(DEFAULT_FILTER)).pixel_filter.weights()
    np.testing.assert_allclose(result, DEFAULT_FILTER.weights(), atol=0.03)


@pytest.mark.parametrize("shape", [(1, 1), (2, 400), (30, 40)])
def test_pictures_without_edges_get_the_default(shape):
    result = estimate_filter(np.full((*shape, 3), 0.3, np.float32))
    assert (result.pixel_filter, result.confidence) == (DEFAULT_FILTER, 0.0)
    assert result.reason == "by default: 0 clear edges"


def test_noise_alone_has_no_clear_edges():
    image = np.random.default_rng(0).random((200, 200, 3))
    assert len(edge_widths(image)) < 20


def test_clipped_edges_are_left_out():
    """Clipped light is sharper than its filter and does not count; unclipped light does."""
    image = bars(PixelFilter("gaussian", 2.8))
    plain, clipped = edge_widths(image), edge_widths(np.minimum(4 * image, 1.0))
    assert len(clipped) < 0.1 * len(plain)


def test_brightness_changes_nothing():
    image = bars(PixelFilter("gaussian", 2.4))
    assert estimate_filter(50 * image).pixel_filter == estimate_filter(image).pixel_filter


def test_rows_are_looked_at_in_any_number(monkeypatch):
    y, x = np.mgrid[:90, :120].astype(np.float32)
    image = np.repeat((0.2 + 0.6 * ((x + 0.3 * y) % 30 < 15))[..., None], 3, -1).astype(np.float32)
    whole = edge_widths(image)
    monkeypatch.setattr("bokehnet.classical.layered.boundaries.edge_spread._BLOCK_ROWS", 7)
    assert len(whole) > 20
    assert np.array_equal(edge_widths(image), whole)


def layers(pixel_filter, hard, seed=0, blur=1.2):
    """Shapes before a soft texture, (160, 220, 3), and their map, both exact.

    Args:
        pixel_filter: Filter of the picture; None composites whole pixels.
        hard: Mask of the shapes at a position, as a function of rows and columns.
    """
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    texture = np.stack([gaussian_filter(rng.random((160, 220)), blur) for _ in range(3)], axis=-1)
    texture = np.clip(0.4 + 0.13 * (texture - texture.mean()) / texture.std(), 0.02, 1)
    rows, columns = np.mgrid[:160, :220].astype(float)
    mask = hard(rows, columns).astype(float)
    coverage = mask
    if pixel_filter is not None:
        fine = hard(*np.mgrid[: 160 * 8, : 220 * 8] / 8 - 7 / 16).astype(float)
        weights = pixel_filter.fine_weights(8)
        beyond = (len(weights) - 8) // 2
        for axis in (0, 1):
            padding = [(0, 0), (0, 0)]
            padding[axis] = (beyond, beyond)
            padded = np.pad(fine, padding, mode="edge")
            size = fine.shape[axis] // 8
            fine = sum(w * np.take(padded, np.arange(size) * 8 + k, axis) for k, w in enumerate(weights))
        coverage = fine
    image = 0.03 * coverage[..., None] + texture * (1 - coverage[..., None])
    return image.astype(np.float32), mask.astype(np.float32)


def wires(rows, columns):
    return (np.abs(columns % 16 - 8) < 0.5) | (np.abs(rows % 16 - 8) < 0.5)


def discs(rows, columns):
    return ((columns % 40 - 20) ** 2 + (rows % 40 - 20) ** 2) < 13.3**2


def slats(rows, columns):
    return (columns + 0.37 * rows) % 23 < 5


@pytest.mark.parametrize("hard", [wires, discs, slats])
@pytest.mark.parametrize("blur", [0.7, 1.2, 2.5])
def test_unmixed_pixels_at_depth_edges_are_a_box_whatever_the_texture(hard, blur):
    """Authority: the composite of whole pixels."""
    result = estimate_filter(*layers(None, hard, blur=blur))
    assert (result.pixel_filter, result.confidence > 0.3) == (PixelFilter("box", 1), True)
    assert "pixels at depth edges are unmixed" in result.reason


@pytest.mark.parametrize("hard", [discs, slats])
@pytest.mark.parametrize(
    "pixel_filter", [DEFAULT_FILTER, PixelFilter("gaussian", 2), PixelFilter("gaussian", 3)]
)
def test_filtered_depth_edges_are_no_box(hard, pixel_filter):
    result = estimate_filter(*layers(pixel_filter, hard))
    assert result.pixel_filter.name != "box"


@pytest.mark.parametrize("hard", [wires, discs, slats])
@pytest.mark.parametrize("shift", [1, 2, 3])
def test_a_map_off_the_edges_is_no_evidence_of_a_box_filter(hard, shift):
    """Authority: the filter that drew the picture; the map is moved."""
    image, disparity = layers(DEFAULT_FILTER, hard)
    assert estimate_filter(image, np.roll(disparity, shift, 1)).pixel_filter.name != "box"


@pytest.mark.parametrize("blur", [0.8, 1.2, 2.0])
def test_texture_alone_is_no_evidence(blur):
    image, _ = layers(None, lambda rows, columns: rows < 0, blur=blur)
    assert estimate_filter(image, np.zeros(image.shape[:2])).pixel_filter == DEFAULT_FILTER
