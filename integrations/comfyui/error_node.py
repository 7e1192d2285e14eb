"""The node that tells how far off a rendering may be."""

from typing import Any, ClassVar

import torch

from bokehnet.render.result import LEVELS_SHOWN

from .host import told
from .render_nodes import FOCUS, CommonInputs, RenderNode, common_widgets, optional_widgets


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
        self, focus_value: float, white: float, focus: dict[str, Any] | None = None, **common: Any
    ) -> tuple[torch.Tensor, float, torch.Tensor]:
        """Return the errors, 1 at ``white`` levels, their mean in levels, and the pictures."""
        with told():
            given = CommonInputs(**common)
            plain = given.settings(focus or {"value": focus_value})
            settings = [plain.updated({"output": {"expected_error": "on"}})] * len(given.image)
            pictures, levels = [], []
            for shown, result in self.results(given.scenes(), settings):
                pictures.append(shown)
                levels.append(torch.from_numpy(result.expected_error))
            every = torch.stack(levels)
            return (every / white).clamp(0, 1), float(every.mean()), torch.stack(pictures)
