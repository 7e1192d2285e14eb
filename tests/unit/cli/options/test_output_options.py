"""Options of the output: colours, bits, coding, metadata."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.io.frame import read_frame
from bokehnet.io.image import read_image, write_image
from bokehnet.io.info import image_info
from tests.unit.io.color import profiles

Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")

SHARP = ("--disparity", "disparity.png", "--blur", 0, "--focus", 0.5, "--engine", "scatter")
SHARP += ("--repair-disparity", "off")


@pytest.fixture
def p3(folder):
    """photo.png in Display P3, and the same values in 16 bits of ProPhoto RGB as TIFF."""
    import tifffile

    levels = np.asarray(Image.open("photo.png"))
    Image.fromarray(levels).save("photo.png", icc_profile=profiles.KNOWN["p3"])
    deep = levels.astype(np.uint16) * 256 + levels[::-1]
    tifffile.imwrite("deep.tif", deep, photometric="rgb", iccprofile=profiles.KNOWN["prophoto"])
    return levels, deep


def test_what_is_not_blurred_comes_back_bit_by_bit(p3, cli):
    import tifffile

    levels, deep = p3
    assert cli("render", "photo.png", *SHARP, "-o", "out.png", "-q").err == ""
    assert_array_equal(np.asarray(Image.open("out.png")), levels)
    assert Image.open("out.png").info["icc_profile"] == profiles.KNOWN["p3"]
    assert cli("render", "deep.tif", *SHARP, "-o", "out.tif", "-q").err == ""
    assert_array_equal(tifffile.imread("out.tif"), deep)
    assert read_frame("out.tif").space.icc == profiles.KNOWN["prophoto"]


def test_options_say_how_it_is_written(p3, cli):
    assert cli("render", "deep.tif", *SHARP, "-o", "out.png", "--bits", 8, "--color-space", "srgb").code == 0
    assert (image_info("out.png").pixel_type, image_info("out.png").color_space) == ("uint8", "sRGB")
    assert cli("render", "photo.png", *SHARP, "-o", "out.png", "--bits", 16).code == 0
    assert (image_info("out.png").pixel_type, image_info("out.png").color_space) == ("uint16", "Display P3")
    sizes = []
    for quality in (30, 95):
        words = ("--quality", quality, "--subsampling", "4:2:0")
        assert cli("render", "photo.png", *SHARP, "-o", "out.jpg", *words).code == 0
        with open("out.jpg", "rb") as file:
            sizes.append(len(file.read()))
    assert sizes[0] < sizes[1] / 2


def test_settings_files_say_the_same(p3, cli, folder):
    (folder / "deep.toml").write_text('[output]\nbits = 16\ncolor_space = "adobe-rgb"\n', encoding="utf-8")
    assert cli("render", "photo.png", *SHARP, "-o", "out.png", "--settings", "deep.toml").code == 0
    info = image_info("out.png")
    assert (info.pixel_type, info.color_space) == ("uint16", "Adobe RGB (1998)")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("-o", "out.jpg", "--bits", 16), ("--bits: expected 8 for .jpg, got 16; write .png or .tif",)),
        (("-o", "out.png", "--bits", 12), ("--bits: expected one of 10, 16, 8, float, half",)),
        (("-o", "out.hdr", "--color-space", "prophoto"), ("--color-space: expected keep or srgb for .hdr",)),
        (("-o", "out.avif", "--max-memory", "2G"), ("--max-memory: expected no limit for AVIF and HEIC",)),
        (("-o", "out.avif", "--bits", 16), ("--bits: expected 8 for .avif, got 16",)),
        (("-o", "out.jpg", "--quality", 0), ("--quality: expected 1 to 100",)),
        (
            ("-o", "out.png", "--quality", 80),
            ("--quality: expected nothing for .png", "got 80; leave it"),
        ),
        (
            ("-o", "out.exr", "--quality", 80, "--subsampling", "4:2:0", "--bits", 8),
            (
                "--quality: expected nothing for .exr",
                "--subsampling: expected nothing",
                "--bits: expected half",
            ),
        ),
        (("-o", "out.webp", "--subsampling", "4:2:0"), ("--subsampling: expected nothing for .webp",)),
    ],
)
def test_impossible_settings_are_reported_before_anything_is_read(folder, cli, options, words):
    outcome = cli("render", "nowhere.png", *SHARP, *options)
    assert outcome.code == 1
    for word in words:
        assert word in outcome.err


def test_exr_from_exr_keeps_its_own(folder, cli):
    outcome = cli("render", "camera.exr", *SHARP, "-o", "out.exr", "--bits", "float")
    assert outcome.code == 1
    assert "--bits: expected nothing for EXR from EXR" in outcome.err


def test_dither_is_for_blurred_light_alone_and_can_be_off(folder, cli):
    words = ("--disparity", "disparity.png", "--blur", 9, "--focus", 0, "--engine", "scatter")
    words += ("--repair-disparity", "off")
    for name, dither in (("a.png", "on"), ("b.png", "off"), ("c.png", "on")):
        assert cli("render", "photo.png", *words, "-o", name, "--dither", dither).code == 0
    pictures = [np.asarray(Image.open(name)).astype(int) for name in ("a.png", "b.png", "c.png", "photo.png")]
    assert_array_equal(pictures[0], pictures[2])
    assert np.abs(pictures[0] - pictures[1]).max() == 1
    assert_array_equal(pictures[0][:, :8], pictures[3][:, :8])  # far from all blur


def test_a_table_profile_is_reported(folder, cli):
    lut = profiles.profile(b"RGB ", {b"desc": profiles.named("printer"), b"A2B0": b"mft2"})
    Image.open("photo.png").save("photo.png", icc_profile=lut)
    outcome = cli("render", "photo.png", *SHARP, "-o", "out.png")
    assert outcome.code == 1
    assert "found 'printer', RGB by a table; convert the picture to sRGB or Display P3 first" in outcome.err


def test_pfm_goes_in_and_out(folder, cli):
    assert cli("render", "camera.exr", *SHARP, "-o", "out.pfm").code == 0
    assert_array_equal(read_image("out.pfm"), read_image("camera.exr"))
    assert cli("render", "out.pfm", *SHARP, "-o", "again.pfm").code == 0
    assert_array_equal(read_image("again.pfm"), read_image("out.pfm"))


def test_quality_of_a_video_is_refused(folder, cli):
    (folder / "clip.mp4").write_bytes(b"not read")
    outcome = cli("render", "clip.mp4", *SHARP, "-o", "out.mp4", "--quality", 80)
    assert (outcome.code, outcome.err.count("\n")) == (1, 1)
    assert "--quality: expected nothing for .mp4, which has none, got 80; leave it out" in outcome.err


def test_quality_passes_in_a_folder_with_formats_that_have_none(folder, cli):
    (folder / "photos").mkdir()
    for name in ("a.jpg", "b.png"):
        write_image(folder / "photos" / name, np.ones((8, 8, 3)))
    words = ("--constant-disparity", 0, *SHARP[2:], "-o", "out", "--quality", 80)
    assert cli("render", "photos", *words).code == 0
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["a.jpg", "b.png"]
