"""Deep EXR: every way it is stored, and what its samples show."""

import contextlib
from itertools import chain

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.input_checks import PIXEL_LIMIT_VARIABLE
from bokehnet.io.exr.deep import flatten, two_surfaces
from bokehnet.io.exr.deep_chunks import DeepSamples
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.maps import read_depth, read_map
from bokehnet.io.pixels import ImageFile
from tests.unit.io.exr.exr_files import deep_samples, read_spec, write_deep

STORED = [(tile, compression) for tile in (0, 8, 7) for compression in ("none", "rle", "zips")]


def one_pixel(*samples):
    """Samples of a single pixel: (Z, ZBack, A, R)."""
    columns = np.array(samples, np.float32).reshape(-1, 4).T
    counts = np.full((1, 1), len(samples))
    return DeepSamples(counts=counts, values=dict(zip(("Z", "ZBack", "A", "R"), columns, strict=True)))


def shown(samples):
    flat = flatten(samples, ["R"])
    return float(flat.light[0, 0, 0]), float(flat.coverage[0, 0]), float(flat.depth[0, 0])


@pytest.mark.parametrize(("tile", "compression"), STORED)
def test_samples_come_as_they_were_written(tmp_path, tile, compression):
    pixels = deep_samples()
    path = write_deep(tmp_path / "a.exr", pixels, tile=tile, compression=compression, x=-3, y=5)
    with ImageFile(path) as file:
        result = file.read_deep(file.parts[0], ["R", "G", "B"])
    assert_array_equal(result.counts, [[len(samples) for samples in row] for row in pixels])
    for name, values in result.values.items():
        written = [sample[name] for samples in chain.from_iterable(pixels) for sample in samples]
        assert_array_equal(values, written)


@pytest.mark.parametrize(("tile", "compression"), STORED)
def test_points_are_composited(tmp_path, tile, compression):
    """Authority: a loop over the samples of each pixel, Porter and Duff's over."""
    pixels = deep_samples()
    path = write_deep(tmp_path / "a.exr", pixels, tile=tile, compression=compression)
    frame = read_frame(path)
    for y, row in enumerate(pixels):
        for x, samples in enumerate(row):
            light, cover = np.zeros(3), 0.0
            for sample in samples:
                light += (1 - cover) * np.array([sample[name] for name in "RGB"], np.float64)
                cover += (1 - cover) * float(sample["A"])
            assert_allclose(frame.image[y, x], light, atol=1e-6)
            assert_allclose(frame.alpha[y, x], cover, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_volumes_give_the_light_of_the_transfer_integral(seed):
    """Authority: emission and absorption along the ray, Max 1995, in 20000 steps of the midpoint rule."""
    rng = np.random.default_rng(seed)
    near = rng.uniform(1, 5, 6)
    far = near + rng.uniform(0.1, 4, 6)
    cover = rng.uniform(0.05, 0.95, 6)
    colour = rng.uniform(0, 1, 6) * cover
    ends = np.linspace(0.5, 10, 20001)
    middles, step = (ends[1:] + ends[:-1]) / 2, ends[1] - ends[0]
    inside = (near[:, None] < middles) & (middles < far[:, None])
    density = inside * (-np.log(1 - cover) / (far - near))[:, None]
    optical = np.cumsum(density.sum(0)) * step
    through = np.exp(-(optical - density.sum(0) * step / 2))
    light = ((colour / cover)[:, None] * density * through).sum() * step
    result = shown(one_pixel(*zip(near, far, cover, colour, strict=True)))
    assert_allclose(result[:2], (light, 1 - np.prod(1 - cover)), rtol=1e-3)


def test_a_volume_cut_in_two_shows_what_it_showed():
    """Beer-Lambert: a layer of coverage a is two halves of coverage 1 - sqrt(1 - a)."""
    half = 1 - np.sqrt(1 - 0.6)
    whole = shown(one_pixel((2, 4, 0.6, 0.3)))
    halves = shown(one_pixel((2, 3, half, 0.5 * half), (3, 4, half, 0.5 * half)))
    assert_allclose(whole[:2], halves[:2], rtol=1e-6)
    with_point = shown(one_pixel((2, 4, 0.6, 0.3), (3, 3, 0.5, 0.2)))
    light = 0.5 * half + (1 - half) * (0.2 + 0.5 * 0.5 * half)
    assert_allclose(with_point[:2], (light, 1 - (1 - half) ** 2 * 0.5), rtol=1e-6)


def test_points_at_one_depth_mix_without_an_order():
    """Hillman 2013, merging: -log(1 - a) adds up, and weighs the colours."""
    cover = 1 - 0.5 * 0.25
    weights = -np.log([0.5, 0.25])
    light = (weights @ [0.4 / 0.5, 0.3 / 0.75]) * cover / weights.sum()
    for samples in ([(2, 2, 0.5, 0.4), (2, 2, 0.75, 0.3)], [(2, 2, 0.75, 0.3), (2, 2, 0.5, 0.4)]):
        assert_allclose(shown(one_pixel(*samples))[:2], (light, cover), rtol=1e-6)
    assert_allclose(shown(one_pixel((2, 2, 1, 0.4), (2, 2, 1, 0.8), (2, 2, 0.5, 9)))[:2], (0.6, 1), rtol=1e-6)


@pytest.mark.parametrize(
    ("samples", "depth"),
    [
        ([], np.inf),
        ([(3, 3, 0.2, 0), (7, 7, 1, 0)], 7),  # a wisp before a wall
        ([(3, 3, 0.6, 0), (7, 7, 1, 0)], 3),
        ([(7, 7, 1, 0), (3, 3, 0.6, 0)], 3),  # whatever the order in the file
        ([(3, 3, 0.2, 0)], 3),  # all there is, though most of the pixel is empty
        ([(3, 3, 0, 0.5), (5, 5, 0, 0.5)], 3),  # light that covers nothing
    ],
)
def test_depth_is_that_of_the_surface_which_fills_more(samples, depth):
    assert shown(one_pixel(*samples))[2] == depth


def test_two_surfaces_part_at_the_widest_gap_and_show_what_all_did():
    samples = one_pixel((2, 2, 0.3, 0.1), (2.1, 2.1, 0.4, 0.2), (8, 8, 0.5, 0.3), (9, 9, 1, 0.4))
    layers = two_surfaces(samples, ["R"])
    assert_allclose([layers.front.depth[0, 0], layers.back.depth[0, 0]], [2, 8], rtol=1e-6)
    assert_allclose(layers.front.coverage[0, 0], 1 - 0.7 * 0.6, rtol=1e-6)
    assert_allclose(layers.back.light[0, 0, 0], 0.3 + 0.5 * 0.4, rtol=1e-6)
    both = layers.front.light + (1 - layers.front.coverage[..., None]) * layers.back.light
    assert_allclose(both, flatten(samples, ["R"]).light, rtol=1e-6)


def test_one_surface_has_nothing_behind_it():
    layers = two_surfaces(one_pixel((2, 2, 0.3, 0.1), (2, 2, 0.5, 0.1)), ["R"])
    assert (layers.back.coverage[0, 0], layers.back.depth[0, 0]) == (0, np.inf)
    assert_allclose(layers.front.coverage[0, 0], 0.65, rtol=1e-6)


@pytest.mark.parametrize("volumes", [False, True])
def test_two_surfaces_of_any_picture_show_it(tmp_path, volumes):
    path = write_deep(tmp_path / "a.exr", deep_samples(most=8, volumes=volumes))
    with ImageFile(path) as file:
        samples = file.read_deep(file.parts[0], ["R", "G", "B"])
    layers, flat = two_surfaces(samples, "RGB"), flatten(samples, "RGB")
    through = 1 - layers.front.coverage[..., None]
    assert_allclose(layers.front.light + through * layers.back.light, flat.light, atol=1e-5)
    assert (layers.front.depth <= layers.back.depth).all()


def test_depth_reads_as_depth_and_empty_pixels_as_sky(tmp_path):
    pixels = deep_samples()
    path = write_deep(tmp_path / "a.exr", pixels)
    depth = read_depth(path)
    empty = np.array([[not samples for samples in row] for row in pixels])
    assert_array_equal(np.isinf(depth), empty)
    assert depth.min() >= 1000


def test_samples_without_coverage_are_opaque(tmp_path):
    pixels = deep_samples()
    path = write_deep(tmp_path / "a.exr", pixels, channels=("R", "G", "B", "Z"))
    frame = read_frame(path)
    first = [[samples[0]["R"] if samples else 0 for samples in row] for row in pixels]
    assert_allclose(frame.image[..., 0], first, atol=1e-6)


def test_samples_without_depth_are_an_error(tmp_path):
    path = write_deep(tmp_path / "a.exr", deep_samples(), channels=("R", "G", "B", "A"))
    with pytest.raises(ImageFileError, match=r"expected deep samples with Z.*found R, G, B, A"):
        read_frame(path)


def test_bokeh_of_a_deep_picture_is_written_flat(tmp_path):
    frame = read_frame(write_deep(tmp_path / "a.exr", deep_samples()))
    write_frame(tmp_path / "b.exr", frame, frame.image)
    assert not read_spec(tmp_path / "b.exr").deep
    assert_allclose(read_frame(tmp_path / "b.exr").image, frame.image, atol=1e-3)
    assert_allclose(read_map(tmp_path / "b.exr", "A"), frame.alpha, atol=1e-3)


@pytest.mark.parametrize(("tile", "compression"), STORED)
def test_every_cut_file_is_an_error_of_one_line(tmp_path, tile, compression):
    data = write_deep(tmp_path / "a.exr", deep_samples(), tile=tile, compression=compression).read_bytes()
    rng = np.random.default_rng(0)
    for length in rng.integers(400, len(data), 30):
        (tmp_path / "b.exr").write_bytes(data[:length])
        with pytest.raises(ImageFileError, match=r"damaged|truncated"):
            read_frame(tmp_path / "b.exr")


def test_more_samples_than_pixels_may_be_are_refused(tmp_path, monkeypatch):
    path = write_deep(tmp_path / "a.exr", deep_samples())
    monkeypatch.setenv(PIXEL_LIMIT_VARIABLE, "321")
    with pytest.raises(ImageFileError, match="deep samples are more than the limit of 321"):
        read_frame(path)


@pytest.mark.parametrize("tile", [0, 8])
def test_places_and_lengths_beyond_the_file_are_an_error(tmp_path, tile):
    data = write_deep(tmp_path / "a.exr", deep_samples(), tile=tile).read_bytes()
    rng = np.random.default_rng(0)
    (tmp_path / "b.exr").write_bytes(data)
    with ImageFile(tmp_path / "b.exr") as file:
        end = file.headers.end
        for place in rng.integers(end, len(data) - 8, 60):
            damaged = data[:place] + b"\xff" * 8 + data[place + 8 :]
            (tmp_path / "b.exr").write_bytes(damaged)
            with contextlib.suppress(ImageFileError):  # and nothing else
                file.read(file.parts[0], ["Z"])


def test_a_channel_whose_name_is_no_text_is_an_error(tmp_path):
    data = write_deep(tmp_path / "a.exr", deep_samples()).read_bytes()
    (tmp_path / "a.exr").write_bytes(data.replace(b"ZBack", b"ZBa\x97k"))
    with ImageFile(tmp_path / "a.exr") as file, pytest.raises(ImageFileError, match="no channel of the name"):
        file.read(file.parts[0], file.parts[0].channels)
