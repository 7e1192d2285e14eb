"""``bokehnet render portrait.jpg -o out.jpg``: photos that hold their own depth."""

import base64
import math
import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.image import read_image
from bokehnet.io.maps import read_map

WIDTH, HEIGHT = 64, 48
LEFT_OUT = "its depth maps, gain maps and additional pictures do not match the result and are omitted"
FAST = ("--engine", "scatter", "--repair-disparity", "off", "--save-maps", "maps")
NEAR, FAR = 0.8, 4.0  # metres
BACK, FRONT = 204, 51  # stored values of background and subject, 255 is FAR
DIAGONAL = math.hypot(36, 24)


def write_bytes(path, array, **attributes):
    spec = oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], "uint8")
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(array), output.geterror()
    assert output.close()


def write_photo(path, units='GDepth:Units="m"', focus="", **exif):
    """A JPEG with a GDepth map: the subject in the middle, written after Google's specification."""
    rng = np.random.default_rng(0)
    blocks = rng.integers(0, 255, (HEIGHT // 8, WIDTH // 8, 3), dtype=np.uint8)
    write_bytes(path, np.kron(blocks, np.ones((8, 8, 1), np.uint8)), **exif)
    stored = np.full((HEIGHT // 2, WIDTH // 2, 1), BACK, np.uint8)
    stored[6:18, 8:24] = FRONT
    inside = path.with_name("map.png")
    write_bytes(inside, stored)
    data = base64.b64encode(inside.read_bytes()).decode()
    xmp = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/" '
        f'xmlns:GFocus="http://ns.google.com/photos/1.0/focus/" GDepth:Format="RangeInverse" {units} {focus} '
        f'GDepth:Near="{NEAR}" GDepth:Far="{FAR}" GDepth:Mime="image/png" GDepth:Data="{data}"/>'
        "</rdf:RDF></x:xmpmeta>"
    )
    payload = b"http://ns.adobe.com/xap/1.0/\0" + xmp.encode()
    jpeg = path.read_bytes()
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + jpeg[2:])


@pytest.fixture
def portrait(tmp_path, monkeypatch, no_bar):
    monkeypatch.chdir(tmp_path)
    write_photo(tmp_path / "portrait.jpg", Exif__FocalLength=4.3, Exif__FocalLengthIn35mmFilm=28, FNumber=1.9)
    return tmp_path


@pytest.fixture
def defocus(portrait, cli):
    def call(*arguments):
        outcome = cli("render", "portrait.jpg", "-o", "out.jpg", *FAST, *arguments)
        assert (outcome.code, outcome.out) == (0, "")
        assert outcome.err.startswith(f"bokehnet: note: portrait.jpg: {LEFT_OUT}\n")
        assert outcome.err.count("\n") == 2
        assert read_image("out.jpg").shape == (HEIGHT, WIDTH, 3)
        return read_map("maps/defocus.exr")

    return call


def metres(stored):
    """RangeInverse: the stored value is linear in 1/distance, 0 is near."""
    return 1 / (1 / NEAR + (1 / FAR - 1 / NEAR) * stored / 255)


def radius(distance, focus, focal_length, f_number):
    """Textbook, pixels, on a full-frame sensor: c / 2 = f^2 (s - d) / (N d (s - f)) / 2, lengths in mm."""
    distance, focus = 1000 * distance, 1000 * focus
    c = focal_length**2 * (focus - distance) / (f_number * distance * (focus - focal_length))
    return c / 2 / (DIAGONAL / math.hypot(WIDTH, HEIGHT))


def test_a_portrait_just_works(defocus):
    """Sharp in its middle, blurred as by a full-frame 28 mm lens, which has the view of its EXIF."""
    result = defocus("--f-number", 1.8)
    assert_allclose(result[24, 32], 0, atol=1e-6)
    assert_allclose(result[2, 2], radius(metres(BACK), metres(FRONT), 28, 1.8), rtol=1e-4)


def test_without_any_option_the_f_number_is_that_of_the_phone(defocus):
    assert_allclose(defocus()[2, 2], radius(metres(BACK), metres(FRONT), 28, 1.9), rtol=1e-4)


def test_options_override_the_metadata_of_the_photo(defocus):
    result = defocus("--f-number", 2, "--focal-length", 50, "--focus-distance", 3)
    assert_allclose(result[2, 2], radius(metres(BACK), 3, 50, 2), rtol=1e-4)
    assert_allclose(result[24, 32], radius(metres(FRONT), 3, 50, 2), rtol=1e-4)
    at_back = defocus("--f-number", 2, "--focus-at", "2,2")
    assert_allclose(at_back[24, 32], radius(metres(FRONT), metres(BACK), 28, 2), rtol=1e-4)


def test_what_the_phone_focused_on_stays_sharp(portrait, defocus):
    write_photo(portrait / "portrait.jpg", focus=f'GFocus:FocalDistance="{metres(BACK)}"', FNumber=1.9)
    result = defocus("--f-number", 1.8)
    assert_allclose(result[2, 2], 0, atol=1e-3)
    assert_allclose(result[24, 32], radius(metres(FRONT), metres(BACK), 26, 1.8), rtol=1e-3)


def test_a_map_without_unit_is_scaled_to_one_metre_for_the_nearest(portrait, defocus):
    """Relative disparity d of 0 to 1 stands for 1/d metres; 26 mm is what most phones have."""
    write_photo(portrait / "portrait.jpg", units="")
    result = defocus("--f-number", 1.8)
    front, back = (1 / (1 - stored / 255) for stored in (FRONT, BACK))
    assert_allclose(result[2, 2], radius(back, front, 26, 1.8), rtol=1e-4)


def test_blur_takes_the_map_as_relative_disparity(defocus):
    result = defocus("--blur", 9, "--focus", 1)
    assert_allclose(result[[24, 2], [32, 2]], [0, -9], atol=1e-5)
    assert_allclose(defocus("--blur", 9)[[24, 2], [32, 2]], [0, -9], atol=1e-5)


def test_a_photo_without_depth_is_reported(portrait, cli):
    write_bytes(portrait / "plain.jpg", np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    outcome = cli("render", "plain.jpg", "-o", "out.jpg", "--f-number", 1.8)
    assert outcome.code == 1
    expected = "expected one of --disparity and --depth, got neither, and plain.jpg has no depth map"
    assert expected in outcome.err
    outcome = cli("render", "portrait.jpg", "-o", "out.jpg", "--focus", 0.5)
    assert (
        "--focus: expected nothing: it does not apply to a photo's own depth "
        "(without --disparity, --depth and --blur" in outcome.err
    )
    outcome = cli("render", "portrait.jpg", "-o", "out.jpg", "--blur", 5, "--f-number", 2)
    assert "--f-number: expected nothing: it does not apply to --blur, got 2; leave it out" in outcome.err
    assert not (portrait / "out.jpg").exists()


def test_strength_takes_the_map_as_relative_disparity(defocus):
    """Authority: 50 is 4 % of the longer side at the farther end."""
    assert_allclose(defocus("--strength", 50)[[24, 2], [32, 2]], [0, -0.04 * WIDTH], rtol=0.02, atol=1e-5)


def test_the_summary_names_the_assumed_focal_length_and_distances(portrait, cli):
    write_photo(portrait / "portrait.jpg", units="", FNumber=1.9)
    outcome = cli("render", "portrait.jpg", "-o", "out.jpg", *FAST)
    assert "; assumed: " in outcome.err
    assert "nearest point at 1 m, farthest at infinity; 26 mm on full frame" in outcome.err


def test_info_describes_the_map_of_a_phone(portrait, cli):
    outcome = cli("info", "portrait.jpg")
    near, far = metres(FRONT), metres(BACK)
    assert (
        f"depth map  {WIDTH // 2} x {HEIGHT // 2} pixels, {near:.3g} m to {far:.3g} m, no focus stored"
        in outcome.out
    )


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        (b"http://ns.adobe.com/hdr-gain-map/1.0/", "Ultra HDR"),
        (b"urn:iso:std:iso:ts:21496:-1", "ISO 21496-1"),
        (b"http://ns.apple.com/HDRGainMap/1.0/", "Apple HDR"),
    ],
)
def test_info_names_a_gain_map(portrait, cli, name, kind):
    """Authority: the names that the specifications give; see bokehnet.io.metadata.gain_map."""
    path = portrait / "portrait.jpg"
    assert "gain map" not in cli("info", path).out
    data = path.read_bytes()
    payload = name + bytes(8)
    path.write_bytes(data[:2] + b"\xff\xe2" + struct.pack(">H", len(payload) + 2) + payload + data[2:])
    assert f"gain map   {kind}" in cli("info", path).out
