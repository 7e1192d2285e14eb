"""Pictures of other libraries, checked against the sRGB formula and against the reader of files."""

import io

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet import as_image, make_scene
from bokehnet.errors import ImageFileError, ParameterError, ShapeError
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.image import read_image, write_image
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import ConstantDisparity

RNG = np.random.default_rng(4)
CODES = RNG.integers(0, 256, (20, 30, 3), np.uint8)
LIGHT = srgb_to_linear(CODES / 255).astype(np.float32)
WIDE = RNG.integers(0, 65536, (20, 30, 3), np.uint16)


@pytest.mark.parametrize(
    ("picture", "options", "expected"),
    [
        (CODES, {}, LIGHT),
        (CODES[..., ::-1], {"bgr": True}, LIGHT),
        (np.moveaxis(CODES, -1, 0), {}, LIGHT),
        (CODES[None], {}, LIGHT),
        (CODES, {"transfer": "linear"}, CODES / 255),
        (WIDE, {}, srgb_to_linear(WIDE / 65535)),
        (LIGHT, {}, LIGHT),
        (8 * LIGHT.astype(np.float64), {}, 8 * LIGHT),
        (LIGHT.astype(np.float16), {}, LIGHT.astype(np.float16)),
        (CODES / np.float32(255), {"transfer": "srgb"}, LIGHT),
        (CODES[..., 0], {}, np.repeat(LIGHT[..., :1], 3, -1)),
        (CODES[..., :1], {}, np.repeat(LIGHT[..., :1], 3, -1)),
        (CODES[:3, :, :3], {"layout": "hwc"}, LIGHT[:3]),
        (CODES[:3, :, :3], {"layout": "chw"}, np.moveaxis(LIGHT[:3], 0, -1)),
        (CODES[..., 0] > 127, {}, np.repeat(CODES[..., :1] > 127, 3, -1)),
    ],
)
def test_arrays(picture, options, expected):
    image = as_image(picture, **options)
    assert image.dtype == np.float32
    assert_allclose(image, expected, atol=1e-6)
    make_scene(image, ConstantDisparity(value=0.5))


def test_alpha_is_straight_and_composited_over_black():
    alpha = RNG.integers(0, 256, (20, 30, 1), np.uint8)
    expected = LIGHT * (alpha / 255)
    assert_allclose(as_image(np.concatenate([CODES, alpha], -1)), expected, atol=1e-6)
    opencv = np.concatenate([CODES[..., ::-1], alpha], -1)
    assert_allclose(as_image(opencv, bgr=True), expected, atol=1e-6)


def test_arrays_that_share_memory_stay_unchanged():
    light = LIGHT.copy()
    image = as_image(light)
    image += 1
    assert_allclose(light, LIGHT)


def test_pictures_of_pil():
    pil = pytest.importorskip("PIL.Image", reason="needs Pillow")
    assert_allclose(as_image(pil.fromarray(CODES)), LIGHT, atol=1e-6)
    grey = pil.fromarray(CODES[..., 0])
    assert_allclose(as_image(grey), np.repeat(LIGHT[..., :1], 3, -1), atol=1e-6)
    assert_allclose(as_image(grey.convert("LA")), np.repeat(LIGHT[..., :1], 3, -1), atol=1e-6)
    wide = pil.fromarray(WIDE[..., 0])
    assert_allclose(as_image(wide), np.repeat(srgb_to_linear(WIDE[..., :1] / 65535), 3, -1), atol=1e-6)
    palette = pil.fromarray(CODES).quantize(16)
    assert_allclose(as_image(palette), as_image(np.asarray(palette.convert("RGB"))))


def test_colour_profiles_of_pil_count(tmp_path):
    """Oracle: the reader of the file with the same profile."""
    pil = pytest.importorskip("PIL.Image", reason="needs Pillow")
    write_image(tmp_path / "p3.png", LIGHT, color_space="display-p3")
    with pil.open(tmp_path / "p3.png") as picture:
        assert_array_equal(as_image(picture), read_image(tmp_path / "p3.png"))


def test_tensors():
    torch = pytest.importorskip("torch", reason="needs torch")
    batch = torch.from_numpy(LIGHT).permute(2, 0, 1)[None]
    for tensor in (batch, batch.double(), batch[0], batch.clone().requires_grad_()):
        assert_allclose(as_image(tensor), LIGHT, atol=1e-6)
    assert_allclose(as_image(batch.bfloat16()), LIGHT, atol=0.005)
    assert_allclose(as_image(torch.from_numpy(CODES)), LIGHT, atol=1e-6)


@pytest.mark.parametrize("extension", ["png", "jpg", "tif", "webp", "exr", "hdr", "pfm"])
def test_encoded_pictures_in_memory(tmp_path, extension):
    """Oracle: the same picture as a file."""
    path = tmp_path / f"picture.{extension}"
    write_image(path, LIGHT)
    expected, data = read_image(path), path.read_bytes()
    stream = io.BytesIO()
    write_image(stream, LIGHT, format=extension)
    assert stream.getvalue() == data
    for source in (data, bytearray(data), memoryview(data), io.BytesIO(data), path):
        assert_array_equal(as_image(source), expected)
        assert_array_equal(read_image(source), expected)


def test_results_are_saved_to_streams(tmp_path):
    result = BokehRenderer("scatter").render_arrays(LIGHT, np.full(LIGHT.shape[:2], 2, np.float32))
    stream = io.BytesIO()
    result.save(stream, format=".png")
    result.save(tmp_path / "result.png")
    assert stream.getvalue() == (tmp_path / "result.png").read_bytes()


@pytest.mark.parametrize(
    ("picture", "error", "words"),
    [
        (CODES.astype(np.int32), ParameterError, "an array of int32; divide it by the value of white"),
        (CODES.astype(np.float32), ParameterError, "whole numbers up to 255"),
        (CODES[:3, :, :3], ParameterError, "both axes of the picture could be channels"),
        (np.zeros((20, 30, 5)), ShapeError, "1, 3 or 4 channels"),
        (np.zeros((2, 20, 30, 3)), ShapeError, "with no empty side"),
        (np.full((20, 30, 3), np.nan), ParameterError, "finite"),
        (b"nonsense", ImageFileError, "found bytes 6e 6f 6e"),
        (b"", ImageFileError, "found bytes nothing"),
        (io.StringIO("text"), ParameterError, "a text stream"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(picture, error, words):
    with pytest.raises(error) as caught:
        as_image(picture)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("image", [CODES, CODES[..., 0], np.zeros((20, 30, 4)), [[0.5]]])
def test_errors_of_other_functions_name_the_helper(image):
    for call in (
        lambda: make_scene(image, ConstantDisparity(value=0.5)),
        lambda: BokehRenderer("scatter").render_arrays(image, np.zeros((20, 30), np.float32)),
    ):
        with pytest.raises((ParameterError, ShapeError), match=r"bokehnet\.as_image\(image\) converts"):
            call()


def test_formats_are_for_streams_only(tmp_path):
    with pytest.raises(ParameterError, match="format of the stream"):
        write_image(io.BytesIO(), LIGHT)
    with pytest.raises(ParameterError, match="nothing for a file"):
        write_image(tmp_path / "a.png", LIGHT, format="png")
