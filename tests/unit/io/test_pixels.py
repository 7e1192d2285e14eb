import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.image import write_image
from bokehnet.io.pixels import ImageFile, apply_orientation

# CIPA DC-008 (Exif): where row 0 and column 0 of the stored picture lie when it is seen upright.
EXIF = {
    1: ("top", "left"),
    2: ("top", "right"),
    3: ("bottom", "right"),
    4: ("bottom", "left"),
    5: ("left", "top"),
    6: ("right", "top"),
    7: ("right", "bottom"),
    8: ("left", "bottom"),
}


def side(picture, name):
    return {"top": picture[0], "bottom": picture[-1], "left": picture[:, 0], "right": picture[:, -1]}[name]


@pytest.mark.parametrize("orientation", EXIF)
def test_orientation_places_row_and_column_zero_by_exif(orientation):
    stored = np.arange(6, dtype=np.float32).reshape(2, 3, 1)
    upright = apply_orientation(stored, orientation)
    row, column = EXIF[orientation]
    assert set(side(upright, row).ravel()) == set(stored[0].ravel())
    assert set(side(upright, column).ravel()) == set(stored[:, 0].ravel())


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
def test_orientation_of_a_file_is_applied(tmp_path, name):
    path = str(tmp_path / name)
    stored = np.zeros((16, 32, 3), np.uint8)
    stored[:, :16] = 255  # the left half of the stored picture; 6 means: column 0 is the visual top
    spec = oiio.ImageSpec(32, 16, 3, "uint8")
    spec.attribute("Orientation", 6)
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec)
    output.write_image(stored)
    output.close()
    with ImageFile(path) as file:
        upright = file.read(file.parts[0], ["G"])
    assert upright.shape == (32, 16, 1)
    assert upright[:15].min() > 0.95
    assert upright[17:].max() < 0.05


@pytest.mark.parametrize("extension", ["jpg", "png", "tif", "webp", "exr", "hdr"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_an_error_in_one_line_and_silent(tmp_path, capfd, extension, kept):
    path = tmp_path / f"a.{extension}"
    write_image(path, np.random.default_rng(0).random((64, 48, 3)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * kept)])
    with pytest.raises(ImageFileError) as caught, ImageFile(path) as file:
        file.read(file.parts[0], file.parts[0].channels)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # the C libraries say nothing of their own


@pytest.mark.parametrize("extension", ["png", "tif", "exr"])
def test_a_flipped_byte_is_found(tmp_path, extension):
    path = tmp_path / f"a.{extension}"
    write_image(path, np.random.default_rng(0).random((64, 48, 3)))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(ImageFileError, match="damaged"), ImageFile(path) as file:
        file.read(file.parts[0], file.parts[0].channels)


def test_bytes_after_the_end_do_no_harm(tmp_path):
    for extension in ("jpg", "png"):
        path = tmp_path / f"a.{extension}"
        write_image(path, np.full((8, 8, 3), 0.5))
        path.write_bytes(path.read_bytes() + b"trailing")
        with ImageFile(path) as file:
            assert file.read(file.parts[0], ["R"]).shape == (8, 8, 1)


def test_what_is_not_an_image_is_named(tmp_path):
    text = tmp_path / "a.txt"
    text.write_text("hello " * 100)
    wrong = tmp_path / "a.png"
    wrong.write_text("hello " * 100)
    for path, reason in (
        (tmp_path / "missing.png", "no such file"),
        (tmp_path, "found a folder"),
        (text, "unknown extension '.txt'.*.exr"),
        (wrong, "expected PNG"),
    ):
        with pytest.raises(ImageFileError, match=reason):
            ImageFile(path)


def test_a_format_is_recognised_by_content(tmp_path):
    write_image(tmp_path / "a.png", np.ones((2, 2, 3)))
    (tmp_path / "a.png").rename(tmp_path / "a.jpg")
    with ImageFile(tmp_path / "a.jpg") as file:
        assert file.file_format == "png"


def test_formats_outside_the_list_are_refused(tmp_path):
    path = str(tmp_path / "a.bmp")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, oiio.ImageSpec(2, 2, 3, "uint8"))
    output.write_image(np.zeros((2, 2, 3), np.uint8))
    output.close()
    with pytest.raises(ImageFileError, match="'bmp'"):
        ImageFile(path)


def test_a_palette_is_expanded(store_png):
    palette = (b"PLTE", bytes([255, 0, 0, 0, 51, 255]))
    with ImageFile(store_png("a.png", 2, 3, [[1, 0]], [palette])) as file:
        values = file.read(file.parts[0], ["R", "G", "B"])
    np.testing.assert_allclose(values, [[[0, 0.2, 1], [1, 0, 0]]], atol=1e-7)


def test_channels_come_in_the_order_asked(tmp_path):
    write_image(tmp_path / "a.exr", np.broadcast_to([1.0, 2.0, 3.0], (2, 2, 3)))
    with ImageFile(tmp_path / "a.exr") as file:
        assert file.read(file.parts[0], ["B", "R"])[0, 0].tolist() == [3, 1]
