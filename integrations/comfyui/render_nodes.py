"""Node that renders single pictures, and the base of all nodes that render."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
import torch

from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.errors import ConfigError
from bokehnet.render.renderer import BokehRenderer
from bokehnet.render.result import RenderReport, RenderResult
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import Scene, make_scene
from bokehnet.settings.settings import RenderSettings, merged
from bokehnet.settings.settings_file import settings_from_table

from .host import (
    CATEGORY,
    Cancel,
    FrameBar,
    frames_of_map,
    image_tensor,
    light,
    maps,
    mattes,
    node_errors,
    photograph,
)

__all__ = [
    "BLUR",
    "FOCUS",
    "BokehRender",
    "CommonInputs",
    "RenderNode",
    "common_widgets",
    "focus_widget",
    "optional_widgets",
]

_ENGINES = ["rays", "scatter", "hybrid", "fast", "neural"]
_OUTPUTS = ("IMAGE", "MASK", "BOKEH_LIGHT", "STRING")
_NAMES = ("bokeh", "error_map", "light", "report")

# Ranges of widgets of a shot, and the value of blur and focus of a still by which the renderer chooses them.
BLUR = {"default": 40.0, "min": 0.0, "max": 1000.0}
FOCUS = {"default": 0.5, "min": 0.0, "max": 1.0, "step": 0.001}
_AUTOMATIC = {"default": -1.0, "min": -1.0}


def focus_widget() -> tuple[str, dict[str, Any]]:
    """Return the widget of the focus of a still."""
    tooltip = "Disparity in focus, 0 to 1, used if focus is not connected; -1: the subject."
    return "FLOAT", {**FOCUS, **_AUTOMATIC, "tooltip": tooltip}


def common_widgets() -> dict[str, Any]:
    """Return the required widgets of all nodes that render."""
    blur = "Blur radius in pixels per unit of disparity; -1: 4 % of the longer side at the far end."
    return {
        "image": ("IMAGE",),
        "disparity": ("IMAGE,MASK", {"tooltip": "Bright is near; normalised to 0..1."}),
        "blur": ("FLOAT", {**BLUR, **_AUTOMATIC, "tooltip": blur}),
        "engine": (_ENGINES,),
        "repair": (["auto", "on", "off"],),
        "invert": ("BOOLEAN", {"default": False, "tooltip": "For maps in which dark is near."}),
    }


def optional_widgets() -> dict[str, Any]:
    """Return the optional inputs of all nodes that render."""
    matte = "Coverage of each pixel by a foreground, such as hair against the sky."
    return {
        "matte": ("MASK", {"tooltip": matte}),
        "look": ("BOKEH_LOOK",),
        "settings_json": (
            "STRING",
            {
                "multiline": True,
                "default": "",
                "tooltip": "Additional settings by groups, as in TOML files.",
            },
        ),
    }


@dataclass(frozen=True, kw_only=True)
class CommonInputs:
    """Values of :func:`common_widgets` and :func:`optional_widgets`: pictures, maps and settings.

    Args:
        image: IMAGE, (frames, H, W, 3), sRGB.
        disparity: IMAGE or MASK, one map for all pictures or one for each.
        blur: Blur radius, pixels per unit of disparity; below 0, the renderer chooses it.
        engine: Name of the engine.
        repair: Repair of the map: auto, on or off.
        invert: True if dark is near in the map.
        matte: MASK, one for all pictures or one for each.
        look: Changes of the settings by a Bokeh Lens / Preset node.
        settings_json: Additional changes, by groups.
    """

    image: torch.Tensor
    disparity: torch.Tensor
    blur: float
    engine: str
    repair: str
    invert: bool
    matte: torch.Tensor | None = None
    look: dict[str, dict[str, Any]] | None = None
    settings_json: str = ""

    def settings(self, focus: dict[str, Any] | None) -> RenderSettings:
        """Return the settings: widgets, overridden by the look, overridden by ``settings_json``.

        Args:
            focus: Fields of the group ``focus``; a value below 0 for the subject; None leaves focus and
                blur to a pull.
        """
        try:
            table = json.loads(self.settings_json or "{}")
        except ValueError as error:
            raise ConfigError(f"settings_json: expected JSON, found an error: {error}") from error
        if not isinstance(table, dict):
            raise ConfigError(f"settings_json: expected an object, found {type(table).__name__}")
        widgets: dict[str, Any] = {"engine": {"name": self.engine}, "depth": {"repair": self.repair}}
        if focus is not None:
            if focus.get("value", 0) < 0:
                focus = {}
            widgets |= {"camera": {"blur": self.blur} if self.blur >= 0 else {}, "focus": focus}
        changes = settings_from_table(table, "settings_json")
        return RenderSettings().updated(merged(widgets, self.look or {}, changes))

    def scenes(self) -> Iterator[Scene]:
        """Yield each picture with its map, normalised to 0..1 separately, and its matte."""
        count = len(self.image)
        frames = (light(self.image), frames_of_map(maps(self.disparity), count), mattes(self.matte, count))
        for number, (picture, values, matte) in enumerate(zip(*frames, strict=True)):
            source = RelativeDisparity(map=values, invert=self.invert)
            yield photograph(make_scene(picture, source, number=number, matte=matte))


def _line(report: RenderReport) -> str:
    """Return the summary of a frame in one line."""
    line = f"{report.engine}, {report.focus_text}, "
    line += f"blur up to {report.largest_blur:.3g} pixels"
    if report.repair_reason:
        line += f", map {'repaired' if report.repaired else 'as it is'} ({report.repair_reason})"
    return line


@cache
def _shared_renderer() -> BokehRenderer:
    """Return the renderer of all nodes, which repairs the map of a picture once."""
    return BokehRenderer()


class RenderNode:
    """A renderer that stays loaded, and the frames of one run."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "render"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = _OUTPUTS
    RETURN_NAMES: ClassVar[tuple[str, ...]] = _NAMES

    def __init__(self) -> None:
        self._renderer = _shared_renderer()

    def results(
        self, scenes: Iterable[Scene], settings: Sequence[RenderSettings], plan: RepairPlan | None = None
    ) -> Iterator[tuple[torch.Tensor, RenderResult]]:
        """Render and preview each frame with its settings; yield the picture and the full result."""
        bar, cancel = FrameBar(len(settings), 2), Cancel()
        for number, (scene, frame_settings) in enumerate(zip(scenes, settings, strict=True)):
            focused = self._renderer.prepare(
                scene, frame_settings, bar.part(number, 0), cancel=cancel, plan=plan
            )
            result = self._renderer.render(focused, frame_settings, bar.part(number, 1), cancel=cancel)
            picture = image_tensor(result.bokeh)
            bar.show(number, picture)
            yield picture, result

    def frames(
        self, scenes: Iterable[Scene], settings: Sequence[RenderSettings], plan: RepairPlan | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Render all frames; return pictures, error maps, unclipped light and summary lines."""
        pictures, errors, lights, lines = [], [], [], []
        for picture, result in self.results(scenes, settings, plan):
            pictures.append(picture)
            errors.append(torch.from_numpy(result.error_map))
            lights.append(result.bokeh)
            lines.append(_line(result.report))
        return torch.stack(pictures), torch.stack(errors), lights, "\n".join(lines)


class BokehRender(RenderNode):
    """Renders the bokeh of each picture from its disparity."""

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        return {
            "required": {**common_widgets(), "focus_value": focus_widget()},
            "optional": {"focus": ("BOKEH_FOCUS",), **optional_widgets()},
        }

    def render(
        self, focus_value: float, focus: dict[str, Any] | None = None, **common: Any
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Return the pictures, their error maps, their unclipped light, and a report."""
        with node_errors():
            inputs = CommonInputs(**common)
            settings = inputs.settings(focus or {"value": focus_value})
            return self.frames(inputs.scenes(), [settings] * len(inputs.image))
