"""The nodes that render: pictures one by one, and the frames of a shot with its pulls."""

import json
from typing import Any, ClassVar

import numpy as np
import torch

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.rendering.depth_source import RelativeDisparity
from bokehnet.rendering.renderer import BokehRenderer
from bokehnet.rendering.scene import make_scene
from bokehnet.rendering.sequence import SequenceSettings, make_pull, settings_at_frame
from bokehnet.rendering.settings import RenderSettings, merged
from bokehnet.rendering.settings_file import settings_from_table

from .host import CATEGORY, Cancel, frames_of_map, image_tensor, light, maps, stages, told

_ENGINES = ["rays", "scatter", "hybrid", "fast", "neural"]
_OUTPUTS = ("IMAGE", "MASK", "BOKEH_LIGHT", "STRING")
_NAMES = ("bokeh", "error_map", "light", "report")

# Ranges of widgets.
_BLUR = {"default": 40.0, "min": 0.0, "max": 1000.0}
_FOCUS = {"default": 0.5, "min": 0.0, "max": 1.0, "step": 0.001}


def _common() -> dict[str, Any]:
    """Widgets of both nodes."""
    return {
        "image": ("IMAGE",),
        "disparity": ("IMAGE", {"tooltip": "Near is bright; stretched to 0..1."}),
        "blur": ("FLOAT", {**_BLUR, "tooltip": "Blur radius in pixels per disparity."}),
        "engine": (_ENGINES,),
        "repair": (["auto", "on", "off"],),
        "invert": ("BOOLEAN", {"default": False, "tooltip": "For maps whose near is dark."}),
    }


def _optional() -> dict[str, Any]:
    return {
        "look": ("BOKEH_LOOK",),
        "settings_json": (
            "STRING",
            {
                "multiline": True,
                "default": "",
                "tooltip": "Further settings by groups, as TOML files have them.",
            },
        ),
    }


def _settings(
    camera: dict[str, Any],
    engine: str,
    repair: str,
    focus: dict[str, Any],
    look: dict[str, dict[str, Any]] | None,
    settings_json: str,
) -> RenderSettings:
    """Settings of the widgets, over them the look, over that the text."""
    try:
        table = json.loads(settings_json or "{}")
    except ValueError as error:
        raise ConfigError(f"settings_json: expected JSON, found an error: {error}") from error
    if not isinstance(table, dict):
        raise ConfigError(f"settings_json: expected an object, found {type(table).__name__}")
    said = {
        "camera": camera,
        "engine": {"name": engine},
        "depth": {"repair": repair},
        "focus": focus,
    }
    return RenderSettings().updated(merged(said, look or {}, settings_from_table(table, "settings_json")))


class _Rendering:
    """A renderer that stays warm with its node, and the frames of one run."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "render"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = _OUTPUTS
    RETURN_NAMES: ClassVar[tuple[str, ...]] = _NAMES

    def __init__(self) -> None:
        self._renderer = BokehRenderer()

    def _frames(
        self,
        image: torch.Tensor,
        disparity: torch.Tensor,
        settings: list[RenderSettings],
        invert: bool,
        as_stored: bool,
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Render each frame by its settings."""
        stage, cancel = stages(len(image), 2), Cancel()
        every = frames_of_map(maps(disparity), len(image))
        pictures = torch.empty((*image.shape[:3], 3), dtype=torch.float32)
        errors, lights, lines = torch.empty(image.shape[:3], dtype=torch.float32), [], []
        for number, (picture, values, said) in enumerate(zip(light(image), every, settings, strict=True)):
            source = RelativeDisparity(map=values, invert=invert, as_stored=as_stored)
            scene = make_scene(picture, source, number=number)
            focused = self._renderer.prepare(scene, said, stage(number, 0), cancel=cancel)
            result = self._renderer.render(focused, said, stage(number, 1), cancel=cancel)
            pictures[number] = image_tensor(result.bokeh)
            errors[number] = torch.from_numpy(result.error_map)
            lights.append(result.bokeh)
            report = result.report
            line = f"{report.engine}, focus at {report.focus_disparity:.3g}, "
            line += f"blur up to {report.largest_blur:.3g} pixels"
            if report.repair_reason:
                repaired = "repaired" if report.repaired else "as it is"
                line += f", map {repaired} ({report.repair_reason})"
            lines.append(line)
        return pictures, errors, lights, "\n".join(lines)


class BokehRender(_Rendering):
    """Bokeh of each picture by its disparity."""

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        value = ("FLOAT", {**_FOCUS, "tooltip": "Without focus."})
        return {
            "required": {**_common(), "focus_value": value},
            "optional": {"focus": ("BOKEH_FOCUS",), **_optional()},
        }

    def render(
        self,
        image: torch.Tensor,
        disparity: torch.Tensor,
        blur: float,
        engine: str,
        repair: str,
        invert: bool,
        focus_value: float,
        focus: dict[str, Any] | None = None,
        look: dict[str, dict[str, Any]] | None = None,
        settings_json: str = "",
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Return the pictures, where they can be wrong, their light unclipped, and what was decided."""
        with told():
            settings = _settings(
                {"blur": blur}, engine, repair, focus or {"value": focus_value}, look, settings_json
            )
            return self._frames(image, disparity, [settings] * len(image), invert, as_stored=False)


class BokehVideo(_Rendering):
    """Bokeh of the frames of a shot, with pulls of focus and blur; maps are taken as they are stored."""

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        return {
            "required": {
                **_common(),
                "focus_from": ("FLOAT", _FOCUS),
                "focus_to": ("FLOAT", _FOCUS),
                "blur_to": ("FLOAT", {**_BLUR, "tooltip": "Of the last frame; blur is that of the first."}),
            },
            "optional": _optional(),
        }

    def render(
        self,
        image: torch.Tensor,
        disparity: torch.Tensor,
        blur: float,
        engine: str,
        repair: str,
        invert: bool,
        focus_from: float,
        focus_to: float,
        blur_to: float,
        look: dict[str, dict[str, Any]] | None = None,
        settings_json: str = "",
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Return as Bokeh Render does, frame by frame."""
        with told():
            if invert:
                raise ParameterError("invert", "false for a shot, whose maps are taken as stored", invert)
            if len(image) == 1:
                focus = {"value": focus_from}
                given = _settings({"blur": blur}, engine, repair, focus, look, settings_json)
                return self._frames(image, disparity, [given], invert, as_stored=True)
            given, frames = _settings({}, engine, repair, {}, look, settings_json), range(len(image))
            pulls = SequenceSettings(
                focus_from=focus_from, focus_to=focus_to, blur_from=blur, blur_to=blur_to
            )
            pull = make_pull(tuple(frames), pulls, metric=False)
            every = [settings_at_frame(given, frame, pull) for frame in frames]
            return self._frames(image, disparity, every, invert, as_stored=True)
