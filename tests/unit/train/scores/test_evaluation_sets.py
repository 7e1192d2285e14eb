import json

import numpy as np
import pytest

from bokehnet.errors import DataFileError, ParameterError
from bokehnet.io.image import write_image, write_map
from train.scores.evaluation_sets import list_pictures


@pytest.fixture
def blb(tmp_path):
    """Two scenes in the layout of the BLB set: depth in one, disparity in the other; two levels each."""
    rng = np.random.default_rng(0)
    for name in ("7", "8"):
        folder = tmp_path / name
        folder.mkdir()
        info = {"blur_parameters": [4.0, 20.0], "focus_distances": [2.0, 8.0]}
        (folder / "info.json").write_text(json.dumps(info))
        write_image(folder / "image.exr", np.full((6, 8, 3), 1.5))
        depth = np.full((6, 8), 4.0)
        depth[:2] = 65504.0
        if name == "7":
            write_map(folder / "depth.exr", depth, channel="Z")
        else:
            write_map(folder / "disparity.exr", 1 / depth)
        for level in range(2):
            for place in range(2):
                write_image(folder / f"bokeh_0{level}_0{place}.exr", 3 * rng.random((6, 8, 3)))
    return tmp_path


def test_blb_triples_are_read_as_their_authors_define_them(blb):
    """Defocus is K * (1 / depth - 1 / focus distance); pictures are clipped to [0, 1]."""
    pictures = list_pictures("blb", blb)
    assert [(p.scene, p.name) for p in pictures[:3]] == [
        ("7", "bokeh_00_00"),
        ("7", "bokeh_00_01"),
        ("7", "bokeh_01_00"),
    ]
    assert len(pictures) == 8
    for picture in (pictures[2], pictures[6]):
        shot = picture.read()
        np.testing.assert_allclose(shot.defocus[3], 20 * (1 / 4 - 1 / 2), rtol=1e-6)
        np.testing.assert_allclose(shot.defocus[0], 20 * (1 / 65504 - 1 / 2), rtol=1e-6)
        np.testing.assert_array_equal(shot.image, 1)
        assert shot.truth.max() == 1
        assert shot.truth.min() < 0.5
        assert shot.disparity[3, 0] == pytest.approx(0.25)


def test_a_limit_counts_scenes(blb):
    assert {picture.scene for picture in list_pictures("blb", blb, 1)} == {"7"}


def test_path_traced_scenes_follow_the_lens_formula(tmp_path):
    """Authority: r = 0.5 f^2 / N * (zf - z) / (z (zf - f)) * W / sensor width, + in front of focus."""
    folder = tmp_path / "room"
    folder.mkdir()
    shot = {
        "file": "out.exr",
        "f_number": 2.0,
        "focus_distance_m": 3.0,
        "blades": 6,
        "blade_rotation_deg": 5.0,
    }
    scene = {"width": 8, "focal_length_mm": 50.0, "sensor_width_mm": 36.0, "shots": [shot]}
    (folder / "scene.json").write_text(json.dumps(scene))
    depth = np.linspace(1, 10, 48).reshape(6, 8)
    depth[0] = 1e10
    write_map(folder / "depth.exr", depth)
    for name in ("image", "out"):
        write_image(folder / f"{name}.exr", np.full((6, 8, 3), 2.0))
    (picture,) = list_pictures("cycles", tmp_path)
    read = picture.read()
    z, zf, f = depth, 3.0, 0.05
    expected = 0.5 * f**2 / 2.0 * (zf - z) / (z * (zf - f)) * 8 / 0.036
    np.testing.assert_allclose(read.defocus, expected, rtol=1e-5, atol=1e-7)
    assert (read.aperture.blades, read.aperture.rotation) == (6, 5)
    assert read.truth.max() == 2


def test_shards_give_every_view(tiny_pairs):
    pictures = list_pictures("shards", tiny_pairs)
    assert len(pictures) == 8
    first, second = (picture.read() for picture in pictures[:2])
    np.testing.assert_array_equal(first.image, second.image)
    assert not np.array_equal(first.truth, second.truth)
    assert first.image.dtype == first.truth.dtype == first.defocus.dtype == np.float32


def test_an_invalid_set_is_reported_in_one_line(tmp_path, blb):
    empty = tmp_path / "empty"
    empty.mkdir()
    for kind in ("shards", "cycles", "blb"):
        with pytest.raises(DataFileError, match="empty"):
            list_pictures(kind, empty)
    with pytest.raises(ParameterError, match="expected one of blb, cycles, shards"):
        list_pictures("photos", blb)
    (blb / "7" / "info.json").write_text('{"blur_parameters": [1], "focus_distances": [1, 2]}')
    with pytest.raises(DataFileError, match="no blur parameter 1 or focus distance 0 for bokeh_01_00"):
        list_pictures("blb", blb)
    (blb / "7" / "info.json").write_text("{}")
    with pytest.raises(DataFileError, match="found no blur_parameters, focus_distances"):
        list_pictures("blb", blb)
