"""Maps of depth: what stays sharp, and edges where the picture has them."""

from typing import Any, ClassVar

import numpy as np
import torch

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import ParameterError, ShapeError

from .host import CATEGORY, FrameBar, frames_of_map, light, map_image, maps, told

_INSIDE = 0.5  # of a mask


def unit_map(values: np.ndarray, invert: bool) -> np.ndarray:
    """Return maps stretched to 0..1, each by itself, near at 1, as the package takes relative disparity."""
    low, high = values.min(axis=(1, 2), keepdims=True), values.max(axis=(1, 2), keepdims=True)
    scaled = (values - low) / np.where(high > low, high - low, 1)
    return np.asarray(1 - scaled if invert else scaled, np.float32)


class BokehFocusPicker:
    """What stays sharp: by a pixel, by the median of a mask, or by a value."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "pick"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("BOKEH_FOCUS", "FLOAT", "IMAGE")
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("focus", "disparity", "preview")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        return {
            "required": {
                "disparity": ("IMAGE,MASK", {"tooltip": "Near is bright."}),
                "by": (["pixel", "mask", "value"],),
                "x": ("INT", {"default": 0, "min": 0, "max": 65535, "tooltip": "Pixel, from the left."}),
                "y": ("INT", {"default": 0, "min": 0, "max": 65535, "tooltip": "Pixel, from the top."}),
                "value": ("FLOAT", {"default": 0.5, "min": 0.0, "max": 1.0, "step": 0.001}),
                "invert": ("BOOLEAN", {"default": False, "tooltip": "For maps whose near is dark."}),
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
        """Return the focus for Bokeh Render, its disparity, and how far all else is from it."""
        with told():
            first = unit_map(maps(disparity)[:1], invert)[0]
            height, width = first.shape
            if by == "pixel":
                if not (x < width and y < height):
                    expected = f"a pixel of the map, below {width} and {height}"
                    raise ParameterError("x, y", expected, (x, y))
                value = float(first[y, x])
            elif by == "mask":
                if mask is None:
                    raise ParameterError("mask", "a mask, which `by` asks for", shown="none")
                inside = mask.cpu().numpy().reshape(-1, *mask.shape[-2:])[0] > _INSIDE
                if inside.shape != first.shape:
                    found = f"{inside.shape[1]}x{inside.shape[0]}"
                    raise ShapeError(f"mask: expected {width}x{height} pixels as the map has, got {found}")
                if not inside.any():
                    raise ParameterError("mask", f"a pixel above {_INSIDE}", shown="none")
                value = float(np.median(first[inside]))
            return {"value": value}, value, map_image(np.abs(first - value)[None])


class BokehDepthRepair:
    """Moves edges of a soft or misplaced map to where the picture has them."""

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
                "disparity": ("IMAGE,MASK", {"tooltip": "Near is bright."}),
                "mode": (["auto", "on", "off"], {"tooltip": "auto: where enough edges are off."}),
                "invert": ("BOOLEAN", {"default": False, "tooltip": "For maps whose near is dark."}),
            }
        }

    def __init__(self) -> None:
        self._repair = DisparityRepair()

    def repair(
        self, image: torch.Tensor, disparity: torch.Tensor, mode: str, invert: bool
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the repaired maps, near is bright, and by how much each pixel was moved."""
        with told():
            bar = FrameBar(len(image), 1)
            given = frames_of_map(unit_map(maps(disparity), invert), len(image))
            found = []
            for number, (picture, values) in enumerate(zip(light(image), given, strict=True)):
                found.append(self._repair(picture, values, mode))
                bar.show(number, map_image(found[-1][None])[0])
            repaired = np.stack(found)
            return map_image(repaired), torch.from_numpy(np.abs(repaired - given))
