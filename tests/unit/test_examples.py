"""The examples do what they say; examples/demo_scene.py is tested beside the demo."""

import runpy

import pytest
import torch

from tests.conftest import ROOT


@pytest.mark.parametrize(("blur", "focus"), [(8.0, 0.46), (6.0, 0.94), (9.0, 0.05)])
def test_gradient_descent_finds_blur_and_focus_of_a_given_picture(blur, focus):
    """Authority: the numbers that made the picture; all starts have four times the blur or more."""
    example = runpy.run_path(str(ROOT / "examples/depth_from_defocus.py"))
    image, disparity = example["small_scene"](6)
    bokeh = example["photograph"](image, disparity, blur, focus)
    assert not torch.allclose(bokeh, image, atol=0.05)
    found = example["recover"](image, disparity, bokeh)
    assert found.blur == pytest.approx(blur, rel=0.02)
    assert found.focus == pytest.approx(focus, rel=0.02, abs=0.002)


def test_the_example_prints_start_truth_and_what_it_found(python_process):
    source = "import runpy; runpy.run_path('examples/depth_from_defocus.py', run_name='__main__')"
    outcome = python_process(source, "--blur", 5, "--focus", 0.5, "--shrink", 8)
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    assert sum(line.startswith("started at blur 40") for line in lines) == 3
    assert lines[-2] == "truth: blur 5.00, focus 0.500"
    assert lines[-1].startswith(("found: blur 4.9", "found: blur 5.0"))
