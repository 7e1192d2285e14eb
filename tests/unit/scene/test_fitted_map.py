"""Maps of another size than their picture."""

import numpy as np
import pytest

from bokehnet.scene.depth.depth_source import DefocusMap, RelativeDisparity
from bokehnet.scene.scene import is_repaired, make_scene, map_at_picture_size
from bokehnet.settings.scene_settings import DepthSettings

PICTURE = np.ones((48, 64, 3), np.float32)
# Of a quarter of the picture's size, and of twice it.
SMALL, LARGE = (np.where(np.arange(n) < n // 2, 0.2, 0.8)[None].repeat(3 * n // 4, 0) for n in (16, 128))


def fitted(source, repair: str) -> np.ndarray:
    scene = make_scene(PICTURE, source)
    settings = DepthSettings(resize=True, repair=repair)
    result = map_at_picture_size(scene, settings)
    assert result.shape == PICTURE.shape[:2]
    return result


@pytest.mark.parametrize("repair", ["auto", "on"])
def test_a_small_map_is_enlarged_smoothly_for_the_repair(repair):
    """Its steps become ramps as wide as its pixels, in the middle of which they stood."""
    row = fitted(RelativeDisparity(map=SMALL.astype(np.float32)), repair)[24]
    assert np.all(np.diff(row) >= -1e-6)
    assert 3 <= np.sum((row > 0.05) & (row < 0.95)) <= 6
    assert np.interp(0.5, row, np.arange(64)) == pytest.approx(31.5, abs=0.05)


@pytest.mark.parametrize(
    ("source", "repair"),
    [
        (RelativeDisparity(map=SMALL.astype(np.float32)), "off"),
        (RelativeDisparity(map=LARGE.astype(np.float32)), "auto"),
        (DefocusMap(map=10 * SMALL.astype(np.float32)), "auto"),
    ],
)
def test_steps_stay_without_sharpening_or_with_a_finer_map(source, repair):
    assert len(np.unique(fitted(source, repair))) == 2


def test_a_map_whose_pixels_were_repeated_is_enlarged_smoothly_too():
    """Authority: the small map itself, given as it is."""
    small = np.random.default_rng(0).random((12, 16), np.float32)
    repeated = RelativeDisparity(map=small.repeat(4, axis=0).repeat(4, axis=1))
    np.testing.assert_array_equal(fitted(repeated, "auto"), fitted(RelativeDisparity(map=small), "auto"))
    untouched = fitted(repeated, "off")
    np.testing.assert_array_equal(untouched, untouched[::4, ::4].repeat(4, axis=0).repeat(4, axis=1))


def test_defocus_is_not_repaired():
    scene = make_scene(PICTURE, DefocusMap(map=np.zeros((48, 64), np.float32)))
    assert not is_repaired(scene, DepthSettings(repair="auto"))
    relative = make_scene(PICTURE, RelativeDisparity(map=np.zeros((48, 64), np.float32)))
    assert is_repaired(relative, DepthSettings(repair="auto"))
    assert not is_repaired(relative, DepthSettings(repair="off"))


@pytest.mark.parametrize(
    ("height", "width", "expected"),
    [
        (24, 32, ()),
        (48, 64, ()),
        (24, 24, ()),
        (24, 20, ("the map of 20x24 pixels is stretched unevenly to the picture of 32x24",)),
    ],
)
def test_a_map_of_another_shape_is_announced(height, width, expected):
    ramp = np.tile(np.linspace(0, 1, width, dtype=np.float32), (height, 1))
    scene = make_scene(np.ones((24, 32, 3), np.float32), RelativeDisparity(map=ramp))
    assert scene.notes == expected
