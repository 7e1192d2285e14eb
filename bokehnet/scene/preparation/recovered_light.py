"""Clipped light of a photograph: measured by its gain map, or estimated from it or from its shot."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.light.recovery import RecoveredLight, measured_light, recover_light
from bokehnet.light.temporal import FrameLight, measure_frame, steady_light
from bokehnet.scene.black_bars import BlackBars, find_black_bars
from bokehnet.scene.scene import Scene
from bokehnet.settings.settings import HighlightSettings, InputSettings

__all__ = ["LightAtPixels", "bars_of", "frame_light", "is_photograph", "light_at_pixels", "recovered_light"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LightAtPixels:
    """Recovered light of the clipped pixels alone, independent of the arrays of its scene.

    Attributes:
        pixels: Indices of the brightened pixels in the flattened picture, (N,).
        values: Their scene-linear light, (N, 3).
        note: Summary in a few words; empty if nothing was recovered.

    Examples:
        >>> light = LightAtPixels(pixels=np.array([5]), values=np.full((1, 3), 9, np.float32), note="1 lamp")
        >>> light.nbytes
        20
    """

    pixels: npt.NDArray[np.intp]
    values: npt.NDArray[np.float32]
    note: str

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.pixels.nbytes + self.values.nbytes


def light_at_pixels(
    scene: Scene,
    nearness: npt.NDArray[np.float32],
    highlights: HighlightSettings,
    bars: BlackBars | None = None,
) -> LightAtPixels:
    """Return the recovered light of the clipped pixels; arguments as :func:`recovered_light`.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> near = np.zeros((8, 8), np.float32)
        >>> scene = make_scene(np.ones((8, 8, 3), np.float32), RelativeDisparity(map=near))
        >>> light_at_pixels(scene, near, HighlightSettings()).nbytes  # no photograph
        0
    """
    light = recovered_light(scene, nearness, highlights, bars)
    values = light.image.reshape(-1, 3)[light.pixels]
    return LightAtPixels(pixels=light.pixels, values=values, note=light.note)


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
    if highlights.threshold == "auto" and scene.extra_light is not None:
        return RecoveredLight.of(scene.image, scene.image + scene.extra_light, 1.0, highlights.strength)
    if highlights.threshold != "auto" or not is_photograph(scene) or frame is None:
        return RecoveredLight(image=scene.image)
    if frame.gain_map is not None:
        light = frame.gain_map.light(frame.image)
        light = light if bars is None else bars.inside(light)
        if light.shape == scene.image.shape:
            return measured_light(scene.image, light, frame.gain_map.kind, highlights.strength)
    if scene.light_sums is not None:
        return steady_light(scene.image, nearness, scene.light_sums, highlights.strength)
    return recover_light(scene.image, nearness, highlights.strength)


def frame_light(scene: Scene, nearness: npt.NDArray[np.float32], inputs: InputSettings) -> FrameLight | None:
    """Return the clipped regions of a frame of a shot; None without any, or with a gain map.

    Args:
        scene: Scene at the size of its file.
        nearness: Map in which near is large, (H, W).
        inputs: Settings of its files.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> near = np.zeros((8, 8), np.float32)
        >>> scene = make_scene(np.ones((8, 8, 3), np.float32), RelativeDisparity(map=near))
        >>> frame_light(scene, near, InputSettings()) is None  # no photograph
        True
    """
    if scene.frame is None or not is_photograph(scene) or scene.frame.gain_map is not None:
        return None
    bars = bars_of(scene, inputs)
    if bars is None:
        return measure_frame(scene.image, nearness)
    return measure_frame(bars.inside(scene.image), bars.inside(nearness))


def bars_of(scene: Scene, inputs: InputSettings) -> BlackBars | None:
    """Return the black bars of an opaque picture without further information about its edges.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> scene = make_scene(np.ones((32, 32, 3), np.float32), ConstantDisparity(value=0))
        >>> bars_of(scene, InputSettings()) is None
        True
    """
    is_plain = scene.known is None and scene.matte is None and scene.depth.layers is None
    is_plain = is_plain and scene.alpha is None and scene.supersampled == 1
    is_plain = is_plain and inputs.projection == "flat" and inputs.stereo is None
    return find_black_bars(scene.image) if is_plain else None


def is_photograph(scene: Scene) -> bool:
    """Return whether a scene is a display-referred picture at the size of its file.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> is_photograph(make_scene(np.ones((32, 32, 3), np.float32), ConstantDisparity(value=0)))
        False
    """
    frame = scene.frame
    return frame is not None and frame.is_display_referred and scene.supersampled == 1
