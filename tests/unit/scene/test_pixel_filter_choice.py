"""Choice of the pixel filter of a picture."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.io.frame import read_frame
from bokehnet.io.metadata.rendered_by import renderer_of
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import ConstantDisparity
from bokehnet.scene.pixel_filter_choice import choose_filter
from bokehnet.scene.scene import make_scene, read_scene
from bokehnet.settings.settings import DepthSettings, RenderSettings

TOLD = {"camera": {"blur": 8}, "focus": {"value": 0.5}, "depth": {"repair": "off"}}


@pytest.mark.parametrize(
    ("attributes", "renderer"),
    [
        ({"cycles.ViewLayer.samples": "16", "Scene": "Scene"}, "cycles"),
        ({"BlenderMultiChannel": "Blender V2.55.1 and newer"}, "blender"),
        ({"arnold/frame": 1.0}, "arnold"),
        ({"vrayInfo/vraycore": "4.30.00"}, None),
        ({}, None),
    ],
)
def test_renderers_are_known_by_what_they_write(attributes, renderer):
    assert renderer_of(attributes) == renderer


def test_the_file_names_its_renderer(tmp_path):
    path = tmp_path / "arnold.exr"
    spec = oiio.ImageSpec(8, 6, 3, "float")
    spec.attribute("arnold/frame", 1.0)
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), spec)
    output.write_image(np.full((6, 8, 3), 0.5, np.float32))
    output.close()
    assert read_frame(path).renderer == "arnold"
    scene = read_scene(path, source=ConstantDisparity(value=0.2))
    choice = choose_filter(scene, "auto")
    assert str(choice) == "gaussian:2 (of arnold, which wrote the file)"
    assert choose_filter(scene, "mitchell").pixel_filter == PixelFilter("mitchell", 4)


def test_without_metadata_the_edges_decide():
    scene = make_scene(np.full((20, 30, 3), 0.5, np.float32), ConstantDisparity(value=0.2))
    choice = choose_filter(scene, "auto")
    assert (choice.pixel_filter, choice.confidence) == (DEFAULT_FILTER, 0.0)


def test_the_report_names_the_filter_of_unmixed_pixels():
    scene = make_scene(np.full((24, 32, 3), 0.5, np.float32), ConstantDisparity(value=0.75))
    settings = RenderSettings().updated({**TOLD, "depth": {"repair": "off", "pixel_filter": "gaussian:1.6"}})
    report = BokehRenderer("rays").render(scene, settings).report
    assert str(report.pixel_filter) == "gaussian:1.6 (as set)"
    assert BokehRenderer("scatter").render(scene, settings).report.pixel_filter is None


def test_the_filter_reaches_the_rays():
    """The purity of the surfaces of an edge pixel depends on the filter."""
    image = np.full((40, 60, 3), 0.1, np.float32)
    image[:, :30], image[:, 30] = 0.9, 0.6
    disparity = np.where(np.arange(60) < 31, 0.9, 0.1).astype(np.float32) * np.ones((40, 1), np.float32)
    renderer = BokehRenderer("rays")
    defocus = 10 * (disparity - 0.5)
    pictures = [
        renderer.render_arrays(
            image, defocus, options=RenderOptions(pixel_filter=PixelFilter(*message))
        ).bokeh
        for message in (("box", 1.0), ("gaussian", 4.0))
    ]
    assert np.abs(pictures[0] - pictures[1]).max() > 0.01


def test_other_filters_are_refused():
    with pytest.raises(ParameterError, match=r"depth\.pixel_filter: expected auto, or one of box, "):
        DepthSettings(pixel_filter="sharp")
    with pytest.raises(ParameterError, match=r"depth\.pixel_filter"):
        DepthSettings(pixel_filter="gaussian:9")


def test_the_settings_name_all_filters():
    from bokehnet.optics.pixels.pixel_filter import FILTER_NAMES
    from bokehnet.settings.scene_settings import FILTERS

    assert FILTERS == FILTER_NAMES
