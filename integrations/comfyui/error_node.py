"""The node that tells how far off a rendering may be."""

from typing import Any, ClassVar

import torch

from bokehnet.rendering.result import LEVELS_SHOWN

from .host import told
from .render_nodes import FOCUS, RenderNode, common_widgets, optional_widgets, scenes_of, settings_of


class BokehExpectedError(RenderNode):
    """How far off each pixel of the rays may be: where to look, and what to mend by hand."""

    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("MASK", "FLOAT", "IMAGE")
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("expected_error", "mean_level", "bokeh")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        shown = {"default": LEVELS_SHOWN, "min": 0.5, "max": 255.0, "step": 0.5}
        return {
            "required": {
                **common_widgets(),
                "engine": (["rays", "hybrid"],),
                "focus_value": ("FLOAT", {**FOCUS, "tooltip": "Without focus."}),
                "white": ("FLOAT", {**shown, "tooltip": "Error, in levels of 255, that is 1 in the mask."}),
            },
            "optional": {"focus": ("BOKEH_FOCUS",), **optional_widgets()},
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
        white: float,
        focus: dict[str, Any] | None = None,
        matte: torch.Tensor | None = None,
        look: dict[str, dict[str, Any]] | None = None,
        settings_json: str = "",
    ) -> tuple[torch.Tensor, float, torch.Tensor]:
        """Return the errors, 1 at ``white`` levels, their mean in levels, and the pictures."""
        with told():
            focused = focus or {"value": focus_value}
            plain = settings_of({"blur": blur}, engine, repair, focused, look, settings_json)
            settings = [plain.updated({"output": {"expected_error": "on"}})] * len(image)
            pictures, levels = [], []
            for shown, result in self.results(scenes_of(image, disparity, matte, invert), settings):
                pictures.append(shown)
                levels.append(torch.from_numpy(result.expected_error))
            every = torch.stack(levels)
            return (every / white).clamp(0, 1), float(every.mean()), torch.stack(pictures)
