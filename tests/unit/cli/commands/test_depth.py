import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.image import write_image
from bokehnet.io.maps import read_depth, read_map
from tests.unit.io.depth import phone_files as files

HEIGHT, WIDTH = 48, 64
MAP = np.tile(np.linspace(0, 255, 16).astype(np.uint8), (12, 1))


@pytest.fixture
def photo(tmp_path, monkeypatch):
    """Work in a folder with photo.png, whose red rises from 0.1 to 0.9 (sRGB) from left to right."""
    monkeypatch.chdir(tmp_path)
    srgb = np.broadcast_to(np.linspace(0.1, 0.9, WIDTH)[:, None], (HEIGHT, WIDTH, 3))
    write_image("photo.png", srgb_to_linear(srgb))
    return tmp_path


@pytest.fixture
def network(photo, write_red_network):
    """tiny.onnx, which returns the red channel that it sees, as disparity or, by metric.toml, as depth."""
    write_red_network(photo)


@pytest.mark.parametrize("output", ["out.exr", "out.png"])
@pytest.mark.parametrize("convention", [["--convention", "tiny.toml"], ["--convention", "midas"], []])
def test_a_network_writes_relative_disparity(cli, network, convention, output):
    outcome = cli("depth", "photo.png", "-o", output, "--model", "tiny.onnx", *convention)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    expected = np.broadcast_to(np.linspace(0, 1, WIDTH), (HEIGHT, WIDTH))
    assert_allclose(read_map(output), expected, atol=0.03)


def test_a_metric_network_writes_what_render_reads_as_depth(cli, network):
    """The network sees ten times the sRGB value: a depth of 1 to 9 m."""
    outcome = cli(
        "depth", "photo.png", "-o", "out.exr", "--model", "tiny.onnx", "--convention", "metric.toml"
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert "--depth-unit 1/m" in outcome.out
    expected = np.broadcast_to(np.linspace(1000, 9000, WIDTH), (HEIGHT, WIDTH))
    assert_allclose(read_depth("out.exr", unit="1/m"), expected, rtol=0.12)


def test_without_a_network_the_map_of_the_phone_is_written(cli, photo):
    picture = files.photo(np.full((HEIGHT, WIDTH, 3), 99, np.uint8))
    content = files.gdepth_photo(files.encode(MAP, "PNG"), near=1, far=2, jpeg=picture)
    (photo / "portrait.jpg").write_bytes(content)
    assert cli("depth", "portrait.jpg", "-o", "out.exr").code == 0
    expected = np.broadcast_to(np.clip(np.linspace(-0.5, 15.5, WIDTH) / 15, 0, 1), (HEIGHT, WIDTH))
    assert_allclose(read_map("out.exr"), 1 - expected, atol=0.03)


def test_a_metric_map_of_a_phone_is_in_inverse_metres(cli, photo):
    content = files.gdepth_photo(files.encode(0 * MAP, "PNG"), near=0.5, far=2, units="m")
    (photo / "portrait.jpg").write_bytes(content)
    assert cli("depth", "portrait.jpg", "-o", "out.exr").code == 0
    assert_allclose(read_map("out.exr"), 2, rtol=1e-6)


def test_a_heic_photo_gives_its_own_map_or_that_of_a_network(cli, network, photo):
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    picture = np.repeat(np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))[..., None], 3, -1)
    (photo / "a.heic").write_bytes(files.heic_with_auxiliary(picture, 255 - picture[..., 0].copy()))
    for network_options, expected in (
        ([], np.linspace(1, 3 / 255, 64)),
        (["--model", "tiny.onnx"], np.linspace(0, 1, 64)),
    ):
        outcome = cli("depth", "a.heic", "-o", "out.exr", *network_options)
        assert (outcome.code, outcome.err) == (0, "")
        assert_allclose(read_map("out.exr"), np.broadcast_to(expected, (48, 64)), atol=0.03)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["photo.png", "-o", "out.exr"],
            ["--model: expected a network", "photo.png has no depth map", "ONNX file"],
        ),
        (
            ["photo.png", "-o", "out.exr", "--convention", "midas"],
            ["--convention: expected --model for it to act on"],
        ),
        (["photo.png", "-o", "out.jpg", "--model", "tiny.onnx"], ["unknown extension '.jpg'"]),
        (["photo.png", "-o", "no/out.exr", "--model", "tiny.onnx"], ["does not exist"]),
        (["photo.png", "-o", "out.exr", "--model", "none.onnx"], ["none.onnx: expected an ONNX file"]),
        (["photo.png", "-o", "out.exr", "--model", "photo.png"], ["photo.png: not a usable ONNX file"]),
        (["none.png", "-o", "out.exr", "--model", "tiny.onnx"], ["none.png: no such file"]),
        (
            ["photo.png", "-o", "out.exr", "--model", "tiny.onnx", "--convention", "mine"],
            ["'mine'", "midas"],
        ),
        (
            ["photo.png", "-o", "out.png", "--model", "tiny.onnx", "--convention", "metric.toml"],
            ["--output: expected .exr, which metric disparity needs, got '.png'"],
        ),
    ],
)
def test_a_mistake_is_reported_in_one_line_and_nothing_is_written(cli, network, photo, arguments, words):
    before = sorted(photo.iterdir())
    outcome = cli("depth", *arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err
    assert sorted(photo.iterdir()) == before
