import math
from dataclasses import replace

import numpy as np
import pytest

from bokehnet import BokehRenderer, CameraSettings, FocusSettings, InputSettings, RenderSettings
from bokehnet.classical.known_layers import Layers
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ImageFileError, ParameterError, ShapeError
from bokehnet.io.channels import write_channels
from bokehnet.scene.depth.depth_source import LayeredDepth
from bokehnet.scene.depth.layer_files import flattened, make_layers, read_layers
from bokehnet.scene.scene import make_scene, read_scene

HEIGHT, WIDTH, EDGE = 48, 96, 40
SETTINGS = RenderSettings(
    camera=CameraSettings(focal_length=200, sensor_width=36, f_number=1.4),
    focus=FocusSettings(distance=4.0),
)


def curtain():
    """A grey curtain at 2 m over the left of a wall at 4 m, which is red behind it and green beside it."""
    near, wall = np.zeros((HEIGHT, WIDTH, 4)), np.ones((HEIGHT, WIDTH, 4))
    near[:, :EDGE] = [0.5, 0.5, 0.5, 1]
    wall[:, :EDGE, :3], wall[:, EDGE:, :3] = [1, 0, 0], [0, 1, 0]
    return [near, wall], [np.full((HEIGHT, WIDTH), depth) for depth in (2.0, 4.0)]


def layered_file(path, pictures, depths):
    channels = {}
    for number, (picture, depth) in enumerate(zip(pictures, depths, strict=True), 1):
        alpha = picture[..., 3]
        for place, name in enumerate("RGB"):
            channels[f"layer{number}.{name}"] = picture[..., place] / np.where(alpha > 0, alpha, 1)
        channels[f"layer{number}.Z"], channels[f"layer{number}.coverage"] = depth, alpha
    flat = flattened(make_layers(pictures, depths))[0]
    channels |= {name: flat[..., place] for place, name in enumerate("RGB")}
    write_channels(path, channels)


def test_a_blurred_curtain_shows_the_wall_behind_it():
    """Authority: the part of a disc beyond a chord, over which the lens sees past the curtain's edge."""
    layers = make_layers(*curtain())
    scene = make_scene(flattened(layers)[0], LayeredDepth(layers=layers))
    result = BokehRenderer("rays").render(scene, SETTINGS)
    radius = result.report.largest_blur
    assert radius > 8
    seen = result.bokeh[HEIGHT // 2, :, 0]
    for inside in (2, 4, 6):  # pixels left of the edge
        t = (inside - 0.5) / radius
        past = (math.acos(t) - t * math.sqrt(1 - t * t)) / math.pi
        expected = (1 - past) * 0.5 + past * 1.0  # the wall is in focus, and red there
        assert seen[EDGE - inside] == pytest.approx(expected, abs=0.03)
    guessed = make_scene(flattened(layers)[0], LayeredDepth(layers=layers))
    guessed = replace(guessed, depth=replace(guessed.depth, layers=None))
    assert BokehRenderer("rays").render(guessed, SETTINGS).bokeh[HEIGHT // 2, EDGE - 2, 0] < 0.4


def test_a_layered_file_gives_what_its_arrays_give(tmp_path):
    pictures, depths = curtain()
    layered_file(tmp_path / "layers.exr", pictures, depths)
    message = replace(SETTINGS, input=InputSettings(layers=tmp_path / "layers.exr"))
    scene = read_scene(tmp_path / "layers.exr", message)
    layers = make_layers(pictures, depths)
    from_arrays = make_scene(flattened(layers)[0], LayeredDepth(layers=layers))
    first, second = (BokehRenderer("rays").render(each, message).bokeh for each in (scene, from_arrays))
    np.testing.assert_allclose(first, second, atol=1e-5)


def test_strips_see_the_layers_of_the_whole():
    """Authority: the same picture in one piece."""
    rng = np.random.default_rng(0)
    colors = rng.random((400, 64, 2, 3), np.float32)
    defocus = np.stack([np.full((400, 64), 5.0), np.full((400, 64), -3.0)], 2).astype(np.float32)
    coverage = np.stack([rng.random((400, 64)) < 0.3, np.ones((400, 64))], 2).astype(np.float32)
    layers = Layers(colors=colors, defocus=defocus, coverage=coverage)
    image = np.where(coverage[:, :, :1] > 0, colors[:, :, 0], colors[:, :, 1])
    nearest = np.where(coverage[:, :, 0] > 0, defocus[:, :, 0], defocus[:, :, 1])
    engine = Engine("rays")
    whole = engine.render(image, nearest, options=RenderOptions(layers=layers))
    parts = engine.render(image, nearest, options=RenderOptions(layers=layers, max_memory=14_000_000))
    assert parts.classical is not None
    np.testing.assert_allclose(parts.bokeh, whole.bokeh, atol=2e-3)


def test_holes_lie_at_no_depth():
    pictures, depths = curtain()
    depths[0][:, EDGE:] = np.nan  # pixels without a surface have no depth
    layers = make_layers(pictures, depths)
    assert np.isfinite(layers.values).all()
    assert flattened(layers)[1][0, -1] == pytest.approx(1 / 4000)


def test_wrong_layers_are_one_line(tmp_path):
    pictures, depths = curtain()
    with pytest.raises(ParameterError, match=r"layers: expected surfaces from front to back.*layer 2 nearer"):
        make_layers(pictures, [depths[1], depths[0]])
    with pytest.raises(ParameterError, match="layers: expected one picture or more"):
        make_layers([], [])
    with pytest.raises(ShapeError, match="a depth for each of 2 pictures, got 1"):
        make_layers(pictures, depths[:1])
    with pytest.raises(ShapeError, match="layer 2: expected 96x48 pixels of four channels"):
        make_layers([pictures[0], pictures[1][1:]], depths)
    with pytest.raises(ParameterError, match="layer 1 alpha: expected 0 to 1"):
        make_layers([2 * pictures[0], pictures[1]], depths)
    with pytest.raises(ShapeError, match=r"input\.layers: expected 10x9 pixels"):
        make_scene(np.ones((9, 10, 3)), LayeredDepth(layers=make_layers(pictures, depths)))
    write_channels(tmp_path / "flat.exr", {"R": np.ones((4, 6))})
    with pytest.raises(ImageFileError, match=r"expected layers .*found R"):
        read_layers(tmp_path / "flat.exr")
    with pytest.raises(ParameterError, match=r"input\.layers: expected neither"):
        InputSettings(layers="a.exr", matte="b.png")
