"""Depth nodes: selection of the focus, and repair of depth edges."""

from typing import Any, ClassVar

import numpy as np
import torch

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.scene.focus_patch import surface_disparity

from .host import CATEGORY, FrameBar, frames_of_map, light, map_image, maps, node_errors

_MASK_THRESHOLD = 0.5


def unit_map(values: np.ndarray, invert: bool) -> np.ndarray:
    """Return maps normalised to 0..1, each separately, with near at 1, as relative disparity."""
    low, high = values.min(axis=(1, 2), keepdims=True), values.max(axis=(1, 2), keepdims=True)
    scaled = (values - low) / np.where(high > low, high - low, 1)
    return np.asarray(1 - scaled if invert else scaled, np.float32)


class BokehFocusPicker:
    """Selects the focus by the surface under a pixel, by the median in a mask, or by a value."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "pick"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("BOKEH_FOCUS", "FLOAT", "IMAGE")
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("focus", "disparity", "preview")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        return {
            "required": {
                "disparity": ("IMAGE,MASK", {"tooltip": "Bright is near."}),
                "by": (["pixel", "mask", "value"],),
                "x": ("INT", {"default": 0, "min": 0, "max": 65535, "tooltip": "Pixel, from the left."}),
                "y": ("INT", {"default": 0, "min": 0, "max": 65535, "tooltip": "Pixel, from the top."}),
                "value": ("FLOAT", {"default": 0.5, "min": 0.0, "max": 1.0, "step": 0.001}),
                "invert": ("BOOLEAN", {"default": False, "tooltip": "For maps in which dark is near."}),
            },
            "optional": {"mask": ("MASK",)},
        }

    def pick(
        self,
        disparity: torch.Tensor,
        by: str,
        x: int,
        y: int,
        value: float,
        invert: bool,
        mask: torch.Tensor | None = None,
    ) -> tuple[dict[str, Any], float, torch.Tensor]:
        """Return the focus for Bokeh Render, its disparity, and the distance of all pixels from it."""
        with node_errors():
            first = unit_map(maps(disparity)[:1], invert)[0]
            height, width = first.shape
            focus: dict[str, Any] = {"value": value}
            if by == "pixel":
                if not (x < width and y < height):
                    expected = f"a pixel of the map, below {width} and {height}"
                    raise ParameterError("x, y", expected, (x, y))
                focus, value = {"at": [x, y]}, surface_disparity(first, x, y)
            elif by == "mask":
                if mask is None:
                    raise ParameterError("mask", "a mask, which `by` requires", shown="none")
                inside = mask.cpu().numpy().reshape(-1, *mask.shape[-2:])[0] > _MASK_THRESHOLD
                if inside.shape != first.shape:
                    size = f"{inside.shape[1]}x{inside.shape[0]}"
                    raise ShapeError(f"mask: expected {width}x{height} pixels as the map has, got {size}")
                if not inside.any():
                    raise ParameterError("mask", f"a pixel above {_MASK_THRESHOLD}", shown="none")
                value = float(np.median(first[inside]))
                focus = {"value": value}
            return focus, value, map_image(np.abs(first - value)[None])


class BokehDepthRepair:
    """Moves the edges of a soft or misaligned map to those of the picture."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "repair"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("IMAGE", "MASK")
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("disparity", "moved")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        return {
            "required": {
                "image": ("IMAGE",),
                "disparity": ("IMAGE,MASK", {"tooltip": "Bright is near."}),
                "mode": (["auto", "on", "off"], {"tooltip": "auto: only if enough edges are misplaced."}),
                "invert": ("BOOLEAN", {"default": False, "tooltip": "For maps in which dark is near."}),
            }
        }

    def __init__(self) -> None:
        self._repair = DisparityRepair()

    def repair(
        self, image: torch.Tensor, disparity: torch.Tensor, mode: str, invert: bool
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the repaired maps, bright is near, and the absolute change of each pixel."""
        with node_errors():
            bar = FrameBar(len(image), 1)
            originals = frames_of_map(unit_map(maps(disparity), invert), len(image))
            results = []
            for number, (picture, values) in enumerate(zip(light(image), originals, strict=True)):
                results.append(self._repair(picture, values, mode))
                bar.show(number, map_image(results[-1][None])[0])
            repaired = np.stack(results)
            return map_image(repaired), torch.from_numpy(np.abs(repaired - originals))
