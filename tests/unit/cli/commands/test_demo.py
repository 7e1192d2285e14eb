import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ShapeError
from bokehnet.io.image import read_image
from bokehnet.io.info import image_info
from bokehnet.io.maps import read_disparity
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.demo import ASSETS, BLUR, FOCUS

WIDTH, HEIGHT = 720, 480
CAT = np.s_[230:380, 230:360]  # rows and columns of the demo's middle distance


def tiles(sheet):
    """Input, disparity and the three renders, by the layout of two centred rows."""
    gap, strip = 12, 34
    step_x, step_y = WIDTH + gap, HEIGHT + strip + gap
    assert sheet.shape == (gap + 2 * step_y, gap + 3 * step_x, 3)
    corners = [(gap, gap + step_x // 2 + k * step_x) for k in range(2)]
    corners += [(gap + step_y, gap + k * step_x) for k in range(3)]
    return [sheet[y : y + HEIGHT, x : x + WIDTH] for y, x in corners]


def test_the_demo_writes_a_sheet_with_each_distance_sharp_in_its_turn(tmp_path, cli, no_bar):
    output = tmp_path / "sheet.png"
    outcome = cli("demo", "--engine", "scatter", "-o", output)
    assert (outcome.code, outcome.err) == (0, "")
    assert str(output) in outcome.out
    picture, disparity, near, middle, far = tiles(read_image(output))
    assert_array_equal(picture, read_image(ASSETS / "demo.png"))
    map_in_file = read_disparity(ASSETS / "demo_disparity.png")
    assert_allclose(read_as_grey(disparity), map_in_file, atol=1 / 255 + 1e-3)  # rounded either way
    in_focus = np.abs(BLUR * (map_in_file - FOCUS["middle"])) < 0.5
    assert in_focus[CAT].mean() > 0.5
    errors = [np.abs(tile - picture)[CAT].mean() for tile in (near, middle, far)]
    assert errors[1] < 0.1 * min(errors[0], errors[2])
    bulb = np.s_[70:86, 238:254]
    contrasts = [tile[bulb].std() for tile in (near, middle, far)]  # the light of lamps is recovered
    assert contrasts[2] > 1.5 * contrasts[1] > 1.5 * contrasts[0]


def read_as_grey(tile):
    """Return the sRGB values of a tile, as a viewer shows them."""
    from bokehnet.io.color.srgb import linear_to_srgb

    return linear_to_srgb(tile[..., 0])


@pytest.mark.parametrize(("arguments", "engine"), [([], "rays"), (["--engine", "fast"], "fast")])
def test_the_default_is_the_rays_into_the_working_folder(
    tmp_path, cli, monkeypatch, random_weights, arguments, engine
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bokehnet.engines.engine.WEIGHTS", random_weights.parent)
    outcome = cli("demo", *arguments)
    assert outcome.code == 0
    assert f"engine {engine}" in outcome.out
    assert [path.name for path in tmp_path.iterdir()] == ["bokehnet_demo.png"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "nowhere/sheet.png"], ["nowhere", "does not exist"]),
        (["-o", "sheet.gif"], ["unknown extension '.gif'"]),
        (["--engine", "magic"], ["hybrid, neural, rays, scatter", "magic"]),
        (["--engine", "hybrid"], ["weights missing", "--engine rays"]),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(tmp_path, cli, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bokehnet.engines.engine.WEIGHTS", tmp_path / "none")
    outcome = cli("demo", *arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_the_demo_needs_neither_extras_nor_a_network(tmp_path, python_process):
    source = (
        "import socket, sys\n"
        "for name in ('torch', 'scipy', 'skimage', 'kornia', 'onnx'):\n    sys.modules[name] = None\n"
        "def refuse(*_, **__):\n    raise OSError('no network')\n"
        "socket.socket.connect = socket.getaddrinfo = refuse\n"
        "from bokehnet.cli import progress\n"
        "import contextlib\n"
        "progress._DELAY, progress.compile_notice = 300.0, contextlib.nullcontext\n"
        "from bokehnet.cli.app import run\n"
        "sys.exit(run(['demo', '--engine', 'scatter', '-o', sys.argv[1]]))"
    )
    outcome = python_process(source, tmp_path / "sheet.jpg")
    assert (outcome.code, outcome.err) == (0, "")
    assert (tmp_path / "sheet.jpg").stat().st_size > 10_000


def test_the_files_of_the_demo_are_small_and_belong_together():
    files = [ASSETS / "demo.png", ASSETS / "demo_disparity.png"]
    assert sum(path.stat().st_size for path in files) < 1_000_000
    picture, disparity = (image_info(path) for path in files)
    assert (picture.width, picture.height) == (disparity.width, disparity.height) == (WIDTH, HEIGHT)
    assert (picture.pixel_type, disparity.pixel_type) == ("uint8", "uint16")
    values = read_disparity(files[1])
    for focus in FOCUS.values():  # something in the picture is at each of the three distances
        assert (np.abs(values - focus) < 0.02).sum() > 1000


def test_the_example_traces_the_files_that_ship(tmp_path, python_process):
    """The disparity does not depend on the samples; an edge pixel may round otherwise on another CPU."""
    pytest.importorskip("torch")
    pytest.importorskip("skimage")
    source = "import runpy; runpy.run_path('examples/demo_scene.py', run_name='__main__')"
    outcome = python_process(source, "--out", tmp_path, "--samples", 2)
    assert outcome.code == 0, outcome.err
    result, shipped = (read_disparity(folder / "demo_disparity.png") for folder in (tmp_path, ASSETS))
    assert (np.abs(result - shipped) > 1e-4).mean() < 1e-3
    result, shipped = (read_image(folder / "demo.png") for folder in (tmp_path, ASSETS))
    assert np.abs(result - shipped).mean() < 0.01
    assert_allclose(result.mean(axis=(0, 1)), shipped.mean(axis=(0, 1)), rtol=0.01)


def test_a_contact_sheet_keeps_its_pictures_and_has_ink_under_them():
    rng = np.random.default_rng(0)
    pictures = [rng.random((30, 90, 3), dtype=np.float32) for _ in range(3)]
    sheet = contact_sheet([[("one", pictures[0])], [("two", pictures[1]), ("three", pictures[2])]])
    assert sheet.shape == (12 + 2 * (30 + 34 + 12), 12 + 2 * (90 + 12), 3)
    for picture, (top, left) in zip(pictures, [(12, 63), (88, 12), (88, 114)], strict=True):
        assert_array_equal(sheet[top : top + 30, left : left + 90], picture)
        assert sheet[top + 30 : top + 64, left : left + 90].max() > 0.5
    assert sheet[:, :12].max() == sheet[:12].max() == sheet[0, 0, 0]


def test_a_contact_sheet_refuses_pictures_of_different_sizes():
    with pytest.raises(ShapeError, match="one size"):
        contact_sheet([[("one", np.zeros((3, 4, 3))), ("two", np.zeros((4, 3, 3)))]])
