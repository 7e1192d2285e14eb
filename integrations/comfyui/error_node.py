"""Node that returns the expected error of a rendering."""

from typing import Any, ClassVar

import torch

from bokehnet.render.result import MAX_SHOWN_LEVELS

from .host import node_errors
from .render_nodes import CommonInputs, RenderNode, common_widgets, focus_widget, optional_widgets


class BokehExpectedError(RenderNode):
    """Expected error of each rendered pixel, to guide manual corrections."""

    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("MASK", "FLOAT", "IMAGE")
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("expected_error", "mean_level", "bokeh")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        levels = {"default": MAX_SHOWN_LEVELS, "min": 0.5, "max": 255.0, "step": 0.5}
        return {
            "required": {
                **common_widgets(),
                "engine": (["rays", "hybrid"],),
                "focus_value": focus_widget(),
                "white": ("FLOAT", {**levels, "tooltip": "Error in 8-bit levels that is 1 in the mask."}),
            },
            "optional": {"focus": ("BOKEH_FOCUS",), **optional_widgets()},
        }

    def render(
        self, focus_value: float, white: float, focus: dict[str, Any] | None = None, **common: Any
    ) -> tuple[torch.Tensor, float, torch.Tensor]:
        """Return the errors, 1 at ``white`` levels, their mean in levels, and the pictures."""
        with node_errors():
            inputs = CommonInputs(**common)
            base = inputs.settings(focus or {"value": focus_value})
            settings = [base.updated({"output": {"expected_error": "on"}})] * len(inputs.image)
            pictures, errors = [], []
            for picture, result in self.results(inputs.scenes(), settings):
                pictures.append(picture)
                errors.append(torch.from_numpy(result.expected_error))
            levels = torch.stack(errors)
            return (levels / white).clamp(0, 1), float(levels.mean()), torch.stack(pictures)
