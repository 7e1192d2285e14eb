"""Primaries of EXR files. Authority: the published matrix from AP1 to Rec.709 with Bradford adaptation."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ImageFileError
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import read_image

AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)

# S-2014-004, "ACEScg - A working space for CGI render and compositing", 2015, combined with IEC 61966-2-1.
AP1_TO_REC709 = np.array(
    [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]
)
COLORS = np.array([[[0.2, 0.5, 0.1], [1.0, 1.0, 1.0], [0.9, 0.1, 0.3]]], np.float32)


def write(path, chromaticities):
    spec = oiio.ImageSpec(3, 1, 3, oiio.FLOAT)
    if chromaticities is not None:
        spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), chromaticities)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(COLORS)
    out.close()


def test_colours_are_converted_from_the_primaries_of_the_file(tmp_path):
    write(tmp_path / "a.exr", AP1)
    assert_allclose(read_image(tmp_path / "a.exr"), COLORS @ AP1_TO_REC709.T, atol=5e-4)
    write(tmp_path / "b.exr", None)
    assert (read_image(tmp_path / "b.exr") == COLORS).all()


def test_the_light_of_a_frame_keeps_its_primaries_and_is_written_back_unchanged(tmp_path):
    write(tmp_path / "a.exr", AP1)
    frame = read_frame(tmp_path / "a.exr")
    assert (frame.image == COLORS).all()
    write_frame(tmp_path / "out.exr", frame, frame.image)
    assert (read_frame(tmp_path / "out.exr").image == COLORS).all()
    assert_allclose(read_image(tmp_path / "out.exr"), COLORS @ AP1_TO_REC709.T, atol=5e-4)


def test_primaries_on_one_line_are_an_error(tmp_path):
    write(tmp_path / "a.exr", (0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3127, 0.329))
    with pytest.raises(ImageFileError, match="chromaticities in its header are invalid"):
        read_image(tmp_path / "a.exr")
