"""Clipped light of a photograph: measured by its gain map, or estimated."""

import numpy as np
import numpy.typing as npt

from bokehnet.light.recovery import RecoveredLight, measured_light, recover_light
from bokehnet.scene.black_bars import BlackBars
from bokehnet.scene.scene import Scene
from bokehnet.settings.settings import HighlightSettings

__all__ = ["recovered_light"]


def recovered_light(
    scene: Scene,
    nearness: npt.NDArray[np.float32],
    highlights: HighlightSettings,
    bars: BlackBars | None = None,
) -> RecoveredLight:
    """Return the picture of a scene, with its clipped light if file and settings allow it.

    Args:
        scene: Scene at the size of its file, without black bars.
        nearness: Map in which near is large, (H, W).
        highlights: Settings.
        bars: Black bars around the scene.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> near = np.zeros((8, 8), np.float32)
        >>> scene = make_scene(np.ones((8, 8, 3), np.float32), RelativeDisparity(map=near))
        >>> recovered_light(scene, near, HighlightSettings()).image is scene.image  # no photograph
        True
    """
    frame = scene.frame
    is_photograph = frame is not None and frame.is_display_referred and scene.supersampled == 1
    if highlights.threshold != "auto" or not is_photograph or frame is None:
        return RecoveredLight(image=scene.image)
    if frame.gain_map is not None:
        light = frame.gain_map.light(frame.image)
        light = light if bars is None else bars.inside(light)
        if light.shape == scene.image.shape:
            return measured_light(scene.image, light, frame.gain_map.kind, highlights.strength)
    return recover_light(scene.image, nearness, highlights.strength)
