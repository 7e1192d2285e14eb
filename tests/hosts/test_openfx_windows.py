"""The OpenFX plug-in by windows, proxies, masks and aborts, in a host of our own. Authority: the renderer."""

import os
import subprocess
import sys

import numpy as np
import pytest

from bokehnet import BokehRenderer, DefocusMap, RenderSettings, make_scene
from tests.conftest import ROOT
from tests.hosts.test_openfx import OPENFX, plugin, pytestmark  # noqa: F401

WIDTH, HEIGHT, CENTER, SIZE = 96, 64, 2.0, 6.0


@pytest.fixture(scope="module")
def picture():
    """Light and distances of a near square before a far wall, upright."""
    rng = np.random.default_rng(5)
    light = np.kron(rng.random((16, 24, 3), dtype=np.float32), np.ones((4, 4, 1), np.float32))
    depth = np.full((HEIGHT, WIDTH), 6, np.float32)
    depth[16:48, 32:64] = 1.4
    return light, depth


@pytest.fixture(scope="module")
def render(plugin, picture, tmp_path_factory):  # noqa: F811
    """Render a window; return the picture, upright, with -1 where nothing was written, and what was said."""
    folder = tmp_path_factory.mktemp("host")
    source = ROOT / "tests/hosts/openfx_host.cpp"
    build = [
        "g++",
        "-std=c++17",
        "-I",
        str(OPENFX / "include"),
        str(source),
        "-ldl",
        "-o",
        str(folder / "host"),
    ]
    subprocess.run(build, check=True)
    (library,) = plugin.glob("bokehnet.ofx.bundle/Contents/*/bokehnet.ofx")

    def run(
        window=None,
        *,
        step=1,
        abort=-1,
        mask=None,
        without=(),
        change=lambda depth: depth,
        python=sys.executable,
        **numbers,
    ):
        light, depth = picture[0][::step, ::step], change(picture[1])[::step, ::step]
        height, width = depth.shape
        ones = np.ones((height, width, 1), np.float32)
        clips = {"Source": np.concatenate([light, ones], -1), "Z": np.repeat(depth[..., None], 4, -1)}
        if mask is not None:
            clips["Mask"] = np.repeat(mask[..., None], 4, -1)
        for name in ("Source", "Z", "Mask"):
            (folder / name).unlink(missing_ok=True)
            if name in clips and name not in without:
                (folder / name).write_bytes(np.ascontiguousarray(clips[name][::-1], np.float32).tobytes())
        reports = {"center": CENTER, "size": SIZE, "max_size": 12, "math": 0, "engine": 1, **numbers}
        where = [str(edge) for edge in window or (0, 0, width, height)]
        words = [folder / "host", library, folder, width, height, *where, 1 / step, abort]
        words += [f"{name}={value}" for name, value in reports.items()]
        environment = dict(os.environ, BOKEHNET_PYTHON=str(python), PYTHONPATH=str(ROOT))
        done = subprocess.run([str(word) for word in words], env=environment, capture_output=True, text=True)
        stored = np.frombuffer((folder / "result").read_bytes(), np.float32).reshape(height, width, 4)
        return stored[::-1], done.stdout

    return run


def by_renderer(picture, step=1):
    light, depth = picture[0][::step, ::step], picture[1][::step, ::step]
    radii = (SIZE * (CENTER / depth - 1) / step).astype(np.float32)
    settings = RenderSettings().updated({"engine": {"name": "scatter"}})
    return BokehRenderer().render(make_scene(light, DefocusMap(map=radii)), settings).bokeh


def test_distance_its_inverse_and_radii_become_the_renderers_picture(render, picture):
    result, message = render()
    assert "status 0" in message
    assert "identity 0" in message
    assert np.abs(result[..., :3] - by_renderer(picture)).max() < 1e-5
    assert (result[..., 3] == 1).all()
    inverse, _ = render(math=1, center=1 / CENTER, change=lambda depth: 1 / depth)
    assert np.abs(inverse - result).max() < 1e-4
    direct, _ = render(math=2, change=lambda depth: SIZE * (CENTER / depth - 1))
    assert np.abs(direct - result).max() < 1e-4


def test_a_window_equals_that_part_of_the_whole_and_only_it_is_written(render):
    whole, _ = render()
    part, _ = render((24, 8, 56, 40))  # rows from the bottom
    rows, columns = slice(HEIGHT - 40, HEIGHT - 8), slice(24, 56)
    assert np.abs(part[rows, columns] - whole[rows, columns]).max() < 1e-4
    written = np.zeros((HEIGHT, WIDTH), bool)
    written[rows, columns] = True
    assert (part[~written] == -1).all()


def test_in_a_proxy_radii_shrink_with_the_picture(render, picture):
    result, _ = render(step=2)
    assert np.abs(result[..., :3] - by_renderer(picture, 2)).max() < 1e-5


def test_a_mask_mixes_the_result_with_the_source(render, picture):
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    mask[:, 48:] = 0.5
    result, _ = render(mask=mask)
    assert np.array_equal(result[:, :48, :3], picture[0][:, :48])
    expected = (by_renderer(picture) + picture[0]) / 2
    assert np.abs(result[:, 48:, :3] - expected[:, 48:]).max() < 1e-5


def test_an_unused_picture_is_not_written(render):
    result, message = render(abort=0, engine=0)
    assert "status 0" in message
    assert (result == -1).all()


def test_no_blur_is_the_source(render):
    assert "identity 1" in render(max_size=0)[1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"without": ("Z",)}, "Z: expected a clip with the depth, found none; connect one"),
        ({"center": 0}, "center: expected a distance above 0 with math depth; set it"),
        ({"python": "/bin/false"}, "BOKEHNET_PYTHON: expected a Python with bokehnet, found /bin/false"),
    ],
)
def test_what_is_wrong_is_one_message(render, arguments, message):
    result, text = render(**arguments)
    assert f"OfxMessageError {message}" in text
    assert "status 1" in text
    assert (result == -1).all()
