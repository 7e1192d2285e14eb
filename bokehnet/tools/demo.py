"""Demo scene of the package, rendered by ``examples/demo_scene.py``, and its contact sheet."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.progress import Progress, part_of
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import Scene, make_scene, read_scene
from bokehnet.settings.settings import CameraSettings, DepthSettings, FocusSettings, RenderSettings
from bokehnet.tools.contact_sheet import contact_sheet

__all__ = ["ASSETS", "BLUR", "FOCUS", "demo_scene", "demo_settings", "demo_sheet", "small_demo_scene"]

# Folder of demo.png and demo_disparity.png.
ASSETS = Path(__file__).parent.parent / "assets"

BLUR = 38.0  # pixels of radius per unit of disparity
FOCUS = {"near": 0.94, "middle": 0.46, "far": 0.0}  # leaves, cat, town


def demo_scene() -> Scene:
    """Return the demo scene; its disparity is exact.

    Examples:
        >>> scene = demo_scene()
        >>> scene.image.shape
        (480, 720, 3)
        >>> round(float(scene.depth.values[240, 256]), 2), FOCUS["middle"]  # the cat
        (0.46, 0.46)
    """
    return read_scene(ASSETS / "demo.png", source=RelativeDisparity(map=ASSETS / "demo_disparity.png"))


def small_demo_scene() -> Scene:
    """Return every fifth row and column of the demo scene.

    Examples:
        >>> small_demo_scene().image.shape
        (96, 144, 3)
    """
    scene = demo_scene()
    disparity = RelativeDisparity(map=scene.depth.values[::5, ::5])
    return make_scene(scene.image[::5, ::5], disparity)


def demo_settings(focus: str) -> RenderSettings:
    """Return the settings of the sheet for a focus, "near", "middle" or "far".

    Examples:
        >>> demo_settings("near").focus.value
        0.94
    """
    return RenderSettings(
        camera=CameraSettings(blur=BLUR),
        focus=FocusSettings(value=FOCUS[focus]),
        depth=DepthSettings(repair="off"),
    )


def demo_sheet(
    renderer: BokehRenderer | None = None, progress: Progress | None = None
) -> npt.NDArray[np.float32]:
    """Return a contact sheet of the scene, its disparity and three focus distances, scene-linear.

    Args:
        renderer: Renderer; default: engine "rays".
        progress: Called with (steps done, total steps).

    Examples:
        >>> demo_sheet(BokehRenderer("scatter")).shape
        (1064, 2208, 3)
    """
    renderer, scene = renderer or BokehRenderer(), demo_scene()
    linear = srgb_to_linear(scene.depth.values)  # viewers then show the stored values
    inputs = [("input", scene.image), ("disparity, near is bright", np.repeat(linear[..., None], 3, axis=-1))]
    results = []
    for index, (name, focus) in enumerate(FOCUS.items()):
        rendered = renderer.render(scene, demo_settings(name), part_of(progress, index, len(FOCUS)))
        results.append((f"focus {name} ({focus:.2f})", rendered.bokeh))
    return contact_sheet([inputs, results])
