"""Clipped light of a shot. Authority: the first analysis of the same shot."""

import numpy as np
from numpy.testing import assert_array_equal

from bokehnet.io.image import write_image
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import read_scene
from bokehnet.sequence.shot import analyse_shot
from bokehnet.settings.settings import RenderSettings

SETTINGS = RenderSettings().updated(
    {"camera": {"blur": 5}, "focus": {"value": 0.5}, "depth": {"repair": "off"}}
)


class Night:
    """Three photographs of a lamp that moves in front of a dark wall."""

    numbers = selected = probes = (1, 2, 3)
    are_files = True

    def __init__(self, folder):
        self.paths = [folder / f"night.{number}.png" for number in self.numbers]
        self.reads = 0
        y, x = np.mgrid[:120, :160]
        for number, path in zip(self.numbers, self.paths, strict=True):
            cover = np.clip(4.3 - np.hypot(y - 60, x - 60.2 - 2 * number), 0, 1)[..., None]
            noise = np.random.default_rng(number).random((120, 160, 1))
            light = 0.006 * (1 + 0.2 * noise) + cover * np.array([6.0, 3.0, 1.2])
            write_image(path, np.minimum(light, 1).astype(np.float32))

    def settings_of(self, index):
        return SETTINGS

    def scenes(self, indices, shot):
        source = RelativeDisparity(map=np.full((120, 160), 0.2, np.float32))
        for index in indices:
            self.reads += 1
            yield read_scene(self.paths[index], SETTINGS, source=source)


def test_a_resumed_run_reads_the_light_instead_of_the_pictures(tmp_path):
    frames, folder = Night(tmp_path), tmp_path / "shot"
    folder.mkdir()
    renderer = BokehRenderer("scatter")
    first = analyse_shot(frames, renderer, folder=folder, steady=False)
    assert frames.reads > 0
    assert first.light.keys() == {1, 2, 3}
    frames.reads = 0
    again = analyse_shot(frames, renderer, folder=folder, steady=False)
    assert frames.reads == 0
    for number, sums in first.light.items():
        assert_array_equal(again.light[number], sums)
