from pathlib import Path

import pytest
import torch

from bokehnet.scenes import read_scene

CONFIGS = sorted((Path(__file__).parents[3] / "configs").glob("scene_*.toml"))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_scene_of_the_repository_can_be_traced(path):
    job = read_scene(path, {"camera.width": 24, "camera.height": 16})
    film = job.tracer().render(2)
    assert bool(torch.isfinite(film.bokeh).all())
    assert float(film.all_in_focus.mean()) > 0.01
    assert float(film.coverage.mean()) > 0.1
    assert len(CONFIGS) >= 2
