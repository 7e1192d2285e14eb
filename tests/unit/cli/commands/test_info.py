import numpy as np
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.frame import read_frame
from bokehnet.io.image import write_image, write_map
from bokehnet.io.info import image_info
from tests.unit.io.color import profiles


def test_info_describes_a_photo(tmp_path, cli):
    write_image(tmp_path / "a.jpg", np.full((4, 6, 3), 0.5))
    outcome = cli("info", tmp_path / "a.jpg")
    assert (outcome.code, outcome.err) == (0, "")
    for text in ("jpeg", "6 x 4 pixels", "R G B (uint8)", "sRGB"):
        assert text in outcome.out


def test_info_prints_the_depth_range_without_the_sky(tmp_path, cli):
    import OpenImageIO as oiio  # noqa: N813

    path = str(tmp_path / "z.exr")
    output = oiio.ImageOutput.create(path)
    spec = oiio.ImageSpec(2, 2, 1, "float")
    spec.channelnames = ("Z",)
    assert output.open(path, spec)
    output.write_image(np.array([[[1.5], [20.0]], [[np.inf], [np.nan]]], np.float32))
    output.close()
    info = image_info(path)
    values = info.ranges["Z"]
    assert (values.lowest, values.highest, values.infinite, values.nan) == (1.5, 20, 1, 1)
    assert info.color_space == "linear"
    outcome = cli("info", path)
    assert "range of Z  1.5 to 20, 1 infinite, 1 NaN" in outcome.out


def test_info_gives_the_size_of_the_upright_picture(tmp_path):
    import OpenImageIO as oiio  # noqa: N813

    path = str(tmp_path / "a.png")
    output = oiio.ImageOutput.create(path)
    spec = oiio.ImageSpec(6, 4, 3, "uint8")
    spec.attribute("Orientation", 8)
    assert output.open(path, spec)
    output.write_image(np.zeros((4, 6, 3), np.uint8))
    output.close()
    info = image_info(path)
    assert (info.width, info.height, info.orientation) == (4, 6, 8)


def test_info_names_the_colour_space_of_maps_and_exr(tmp_path):
    write_map(tmp_path / "m.exr", np.ones((2, 2)), channel="disparity")
    write_image(tmp_path / "i.exr", np.ones((2, 2, 3)))
    assert list(image_info(tmp_path / "m.exr").ranges) == ["disparity"]
    info = image_info(tmp_path / "i.exr")
    assert (info.pixel_type, info.color_space, info.ranges, info.parts) == ("half", "linear", {}, 1)


def test_info_prints_the_reason_for_a_refused_profile_and_the_rest(tmp_path, cli):
    """A profile that is a table, as printers have them."""
    table = profiles.profile(b"RGB ", {b"desc": profiles.named("lut"), b"A2B0": b"mft2"})
    Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")  # noqa: N806
    picture = Image.new("RGB", (6, 4), (200, 100, 50))
    picture.save(tmp_path / "a.jpg", icc_profile=table)
    with pytest.raises(ImageFileError) as error:
        read_frame(tmp_path / "a.jpg")
    info = image_info(tmp_path / "a.jpg")
    assert (info.width, info.height, info.color_space) == (6, 4, "")
    assert info.refusal == str(error.value)
    outcome = cli("info", tmp_path / "a.jpg")
    assert (outcome.code, outcome.err) == (0, "")
    assert "6 x 4 pixels" in outcome.out
    assert f"no picture ({str(error.value).removeprefix(str(tmp_path / 'a.jpg') + ': ')})" in outcome.out


def test_info_finds_out_a_damaged_file(tmp_path):
    write_image(tmp_path / "a.jpg", np.random.default_rng(0).random((64, 64, 3)))
    whole = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "a.jpg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ImageFileError, match="truncated"):
        image_info(tmp_path / "a.jpg")


def test_info_describes_a_numpy_array(tmp_path, cli):
    np.save(tmp_path / "z.npy", np.array([[1.5, 20, np.inf], [np.nan, 3, 4]], np.float32))
    outcome = cli("info", tmp_path / "z.npy")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines()[1:] == [
        "  format           npy",
        "  size             3 x 2 pixels",
        "  channels         values (float32)",
        "  read as          no picture (NumPy files hold maps); unchanged as a map",
        "  range of values  1.5 to 20, 1 infinite, 1 NaN",
    ]


def test_info_describes_the_arrays_of_an_archive(tmp_path, cli):
    """The map that a render reads comes first; an array that is no map has a name only."""
    counts = np.array([[500, 4500, 0]], np.uint16)
    others = {"mask": np.ones((1, 3), bool), "focal_length": np.array([50.0])}
    np.savez(tmp_path / "a.npz", **others, depth=counts)
    outcome = cli("info", tmp_path / "a.npz")
    assert (outcome.code, outcome.err) == (0, "")
    for text in (
        "npz",
        "3 x 1 pixels",
        "depth mask focal_length (uint16)",
        "range of depth  0 to 4500",
        "range of mask   1 to 1",
    ):
        assert text in outcome.out


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
def test_info_refuses_a_numpy_file_without_a_map(tmp_path, cli, name):
    (np.save if name == "a.npy" else np.savez)(tmp_path / name, np.zeros((2, 3, 4)))
    outcome = cli("info", tmp_path / name)
    assert (outcome.code, outcome.out) == (1, "")
    assert "expected an array of numbers (H, W), found float64 of shape (2, 3, 4)" in outcome.err
