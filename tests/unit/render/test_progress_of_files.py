"""Progress of reading and writing increases from a small fraction to 1 for all formats."""

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import CameraSettings, DepthSettings, FocusSettings, RenderSettings

SETTINGS = RenderSettings(
    camera=CameraSettings(blur=4), focus=FocusSettings(value=0.5), depth=DepthSettings(repair="off")
)


class RecordedProgress:
    def __init__(self):
        self.fractions = []

    def __call__(self, done, total):
        self.fractions.append(done / total)


@pytest.fixture
def files(tmp_path):
    rng = np.random.default_rng(0)
    for extension in ("exr", "jpg"):
        write_image(tmp_path / f"photo.{extension}", rng.random((1100, 1000, 3), dtype=np.float32))
    write_map(tmp_path / "map.png", np.linspace(0, 1, 1100)[:, None].repeat(1000, 1))
    return tmp_path


@pytest.mark.parametrize("name", ["out.png", "out.jpg", "out.tif", "out.webp", "out.exr", "out.pfm"])
@pytest.mark.parametrize("photo", ["photo.jpg", "photo.exr"])
def test_reading_and_writing_report_progress(files, photo, name):
    reading, writing = RecordedProgress(), RecordedProgress()
    scene = read_scene(files / photo, source=RelativeDisparity(map=files / "map.png"), progress=reading)
    BokehRenderer("scatter").render(scene, SETTINGS).save(files / name, writing)
    for progress in (reading, writing):
        assert progress.fractions == sorted(progress.fractions)
        assert len(set(progress.fractions)) >= 4
        assert progress.fractions[0] < 0.35
        assert 0.8 < progress.fractions[-1] <= 1


def test_an_exception_of_a_callback_ends_writing_and_leaves_no_file(files):
    scene = read_scene(files / "photo.jpg", source=RelativeDisparity(map=files / "map.png"))
    result = BokehRenderer("scatter").render(scene, SETTINGS)

    def stop(done, total):
        raise KeyboardInterrupt

    existing = set(files.iterdir())
    for extension in ("png", "jpg", "exr"):
        with pytest.raises(KeyboardInterrupt):
            result.save(files / f"out.{extension}", stop)
    assert set(files.iterdir()) == existing
