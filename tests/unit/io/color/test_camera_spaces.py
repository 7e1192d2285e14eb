"""Camera and film colour spaces against published code values and against OpenColorIO in OpenImageIO."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from bokehnet.errors import BokehnetError
from bokehnet.io.color.camera_spaces import INPUT_COLOR_SPACES
from bokehnet.io.color.color_space import convert
from bokehnet.io.frame import read_frame, write_frame

# Stored value of 18 % grey, and its tolerance as printed. ARRI 2017, table 3: 0.391; Sony 2014: code 420;
# Panasonic 2014: code 433; Academy S-2016-001: 0.4135884; Kodak 1995: density 0.002 per code from white 685.
GREY = {
    "logc3": (0.391, 5e-4),
    "slog3": (420 / 1023, 1e-6),
    "slog3-cine": (420 / 1023, 1e-6),
    "vlog": (433 / 1023, 5e-4),
    "acescct": (0.4135884, 1e-6),
    "cineon": (470 / 1023, 3e-3),
    "acescg": (0.18, 0),
}
BUILT_IN = {
    "logc3": "ARRI LogC3 (EI800)",
    "slog3": "S-Log3 S-Gamut3",
    "slog3-cine": "S-Log3 S-Gamut3.Cine",
    "vlog": "V-Log V-Gamut",
    "acescct": "ACEScct",
    "acescg": "ACEScg",
}


@pytest.mark.parametrize(("name", "expected"), GREY.items())
def test_grey_has_the_published_code_value(name, expected):
    stored = INPUT_COLOR_SPACES[name].encode(np.full((1, 3), 0.18))
    np.testing.assert_allclose(stored, expected[0], atol=expected[1] + 1e-12)


@pytest.mark.parametrize("name", [name for name in INPUT_COLOR_SPACES if not name.startswith("prophoto")])
def test_encoding_inverts_decoding(name):
    space = INPUT_COLOR_SPACES[name]
    light = np.geomspace(1e-5, 1, 400)[:, None].repeat(3, 1)
    np.testing.assert_allclose(space.decode(space.encode(light)), light, rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize(("name", "reference"), BUILT_IN.items())
def test_light_and_primaries_agree_with_opencolorio(name, reference):
    """Authority: OpenColorIO's studio configuration, which adapts the white by CAT02, not Bradford."""
    config = oiio.ColorConfig("ocio://studio-config-latest")
    if reference not in config.getColorSpaceNames():
        pytest.skip(f"OpenImageIO {oiio.__version__} has no OpenColorIO with {reference}")
    stored = np.random.default_rng(0).uniform(0.1, 0.75, (16, 16, 3)).astype(np.float32)
    buffer = oiio.ImageBuf(oiio.ImageSpec(16, 16, 3, "float"))
    buffer.set_pixels(oiio.ROI(), stored)
    expected = oiio.ImageBufAlgo.colorconvert(
        buffer, reference, "ACES2065-1", colorconfig="ocio://studio-config-latest"
    ).get_pixels(oiio.FLOAT)
    space = INPUT_COLOR_SPACES[name]
    light = convert(space.decode(stored), space, INPUT_COLOR_SPACES["aces2065-1"])
    error = np.abs(light - expected).max(-1) / np.abs(expected).max(-1)
    assert error.max() < 0.02
    assert np.median(error) < 0.005


def write_dpx(path, stored, transfer, bits=10):
    """Write stored values (H, W, 3), 0 to 1, by OpenImageIO."""
    spec = oiio.ImageSpec(stored.shape[1], stored.shape[0], 3, "uint16")
    spec.attribute("oiio:BitsPerSample", bits)
    spec.attribute("dpx:Transfer", transfer)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image((stored * 65535).astype(np.uint16))
    output.close()


@pytest.mark.parametrize("transfer", ["Printing density", "Logarithmic"])
def test_a_film_scan_says_that_it_is_logarithmic(tmp_path, transfer):
    """Authority: Kodak's code 470 of 18 % grey, white at 685."""
    stored = np.full((6, 8, 3), 470 / 1023)
    stored[0] = 685 / 1023
    write_dpx(tmp_path / "scan.dpx", stored, transfer)
    frame = read_frame(tmp_path / "scan.dpx")
    np.testing.assert_allclose(frame.image[1:], 0.18, rtol=0.02)
    np.testing.assert_allclose(frame.image[0], 1, rtol=0.01)
    assert any("Cineon film log" in note for note in frame.notes)
    assert not frame.is_display_referred


def test_a_scan_without_a_curve_needs_the_option(tmp_path):
    write_dpx(tmp_path / "scan.dpx", np.full((6, 8, 3), 0.391), "User defined")
    with pytest.raises(BokehnetError, match="does not name the transfer curve"):
        read_frame(tmp_path / "scan.dpx")
    frame = read_frame(tmp_path / "scan.dpx", color_space="logc3")
    np.testing.assert_allclose(frame.image, 0.18, rtol=0.01)
    assert not frame.notes


@pytest.mark.parametrize("name", [".png", ".tif"])
def test_untouched_pixels_keep_their_codes_in_the_same_space(tmp_path, name):
    stored = np.random.default_rng(1).uniform(0.1, 0.95, (12, 16, 3))
    write_dpx(tmp_path / "scan.dpx", stored, "User defined", bits=16)
    frame = read_frame(tmp_path / "scan.dpx", color_space="logc3")
    assert frame.image.max() > 10  # light above white
    write_frame(tmp_path / f"out{name}", frame, frame.image)
    written = oiio.ImageBuf(str(tmp_path / f"out{name}")).get_pixels(oiio.UINT16)
    codes = (stored * 65535).astype(np.uint16)
    assert np.abs(written.astype(int) - codes).max() <= 2


def test_eight_bits_of_a_logarithm_are_refused(tmp_path):
    write_dpx(tmp_path / "scan.dpx", np.full((6, 8, 3), 0.4), "Logarithmic")
    frame = read_frame(tmp_path / "scan.dpx")
    with pytest.raises(BokehnetError, match="needs 16 bits"):
        write_frame(tmp_path / "out.jpg", frame, frame.image)
