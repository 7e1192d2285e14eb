"""The examples do what they say; examples/demo_scene.py is tested beside the demo."""

import runpy

import numpy as np
import pytest
import torch

from bokehnet.scenes import read_scene
from tests.conftest import ROOT
from train.scores.metrics import encode


@pytest.mark.parametrize(("blur", "focus"), [(8.0, 0.46), (6.0, 0.94), (9.0, 0.05)])
def test_gradient_descent_finds_blur_and_focus_of_a_given_picture(blur, focus):
    """Authority: the numbers that made the picture; all starts have four times the blur or more."""
    example = runpy.run_path(str(ROOT / "examples/depth_from_defocus.py"))
    image, disparity = example["small_scene"](6)
    bokeh = example["photograph"](image, disparity, blur, focus)
    assert not torch.allclose(bokeh, image, atol=0.05)
    result = example["recover"](image, disparity, bokeh)
    assert result.blur == pytest.approx(blur, rel=0.02)
    assert result.focus == pytest.approx(focus, rel=0.02, abs=0.002)


def test_the_example_prints_start_truth_and_what_it_found(python_process):
    source = "import runpy; runpy.run_path('examples/depth_from_defocus.py', run_name='__main__')"
    outcome = python_process(source, "--blur", 5, "--focus", 0.5, "--shrink", 8)
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    assert sum(line.startswith("started at blur 40") for line in lines) == 3
    assert lines[-2] == "truth: blur 5.00, focus 0.500"
    assert lines[-1].startswith(("found: blur 4.9", "found: blur 5.0"))


def test_our_tracer_answers_for_rays_into_the_scene():
    """Authority: the same tracer's own picture of many rays."""
    example = runpy.run_path(str(ROOT / "examples/selective_rays.py"))
    size = {"camera.width": 48, "camera.height": 32, "camera.shutter": 0.0, "render.bounces": 1}
    result = example["pictures"](read_scene(ROOT / "configs/scene_balls.toml", size), 32, 128)
    truth = encode(result["truth"][0])
    error = {name: float(((encode(picture) - truth) ** 2).mean()) for name, (picture, _) in result.items()}
    assert error["hybrid, ours"] < 0.8 * min(error["scatter"], error["rays, as many"])
    assert error["hybrid, tan"] < 0.8 * error["tan"]
    assert 0 < result["hybrid, ours"][1] <= 0.36 * 32


def test_rays_of_the_example_meet_what_the_scene_file_places():
    """Authority: the near ball of the file, 40 mm around (110, 100, 650) mm."""
    example = runpy.run_path(str(ROOT / "examples/selective_rays.py"))
    job = read_scene(ROOT / "configs/scene_balls.toml", {"camera.shutter": 0.0})
    way = np.array([[110, 100, 650.0], [0, -2000, 1.0]]) / np.array([[650.0], [1.0]])
    color, depth, hit = example["make_ray_tracer"](job)(np.zeros((2, 3)), way)
    distance = np.linalg.norm([110, 100, 650]) - 40
    assert depth[0] == pytest.approx(distance * 650 / np.linalg.norm([110, 100, 650]), rel=1e-4)
    assert hit.tolist() == [True, False]
    assert color.shape == (2, 3)


def test_layered_gradients_recover_depth_through_an_occlusion():
    """Authority: the radii with which the numba rays made the picture."""
    example = runpy.run_path(str(ROOT / "examples/depth_through_occlusion.py"))
    image, wall, bar = example["make_scene"]()
    bokeh = example["photograph"](image, wall, bar)
    radii = example["recover"]("layered", image, wall, bar, bokeh, 25)
    scattered = example["recover"]("scatter", image, wall, bar, bokeh, 25)
    truth = torch.tensor(example["TRUTH"])
    assert (radii - truth).abs()[:3].mean() < 0.5 * (scattered - truth).abs()[:3].mean()
