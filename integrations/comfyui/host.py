"""What nodes share with ComfyUI: tensors, progress, cancelling, errors in one line."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import comfy.model_management
import comfy.utils
import numpy as np
import torch
from PIL import Image

from bokehnet.errors import BokehnetError, RenderCancelled, ShapeError
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear

__all__ = [
    "CATEGORY",
    "Cancel",
    "FrameBar",
    "NodeError",
    "frames_of_map",
    "image_tensor",
    "light",
    "map_image",
    "maps",
    "mattes",
    "told",
]

CATEGORY = "bokehnet"

# Luma of a map that came as colours: its three channels are alike, or nearly so after a lossy file.
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


class NodeError(Exception):
    """What ComfyUI shows at the node: one line."""


class Cancel:
    """Whether the user has pressed cancel."""

    def is_set(self) -> bool:
        """Ask ComfyUI."""
        return bool(comfy.model_management.processing_interrupted())


@contextmanager
def told() -> Iterator[None]:
    """Turn errors of the package into one line at the node, and a cancelled rendering into ComfyUI's own."""
    try:
        yield
    except RenderCancelled:
        comfy.model_management.throw_exception_if_processing_interrupted()
        raise
    except BokehnetError as error:
        raise NodeError(" ".join(str(error).split())) from None


class FrameBar:
    """The node's one bar over all parts of all frames, and each finished frame as the node's preview.

    Args:
        frames: How many.
        parts: Of each frame.
    """

    _STEPS, _WIDEST = 1000, 512

    def __init__(self, frames: int, parts: int) -> None:
        self._parts = parts
        self._bar = comfy.utils.ProgressBar(frames * parts * self._STEPS)

    def part(self, frame: int, part: int) -> Callable[[int, int], None]:
        """Return the progress callback of a part of a frame."""
        begin = (frame * self._parts + part) * self._STEPS

        def report(done: int, total: int) -> None:
            self._bar.update_absolute(begin + self._STEPS * done // max(total, 1))

        return report

    def show(self, frame: int, picture: torch.Tensor) -> None:
        """Show a finished frame, (H, W, 3) as in an IMAGE."""
        shown = Image.fromarray((picture * 255 + 0.5).to(torch.uint8).numpy())
        self._bar.update_absolute(
            (frame + 1) * self._parts * self._STEPS, None, ("JPEG", shown, self._WIDEST)
        )


def light(image: torch.Tensor) -> Iterator[np.ndarray]:
    """Give the frames of an IMAGE as scene-linear light, (H, W, 3)."""
    if image.ndim != 4 or image.shape[3] not in (3, 4):
        raise ShapeError(f"image: expected shape (frames, H, W, 3), got {tuple(image.shape)}")
    for frame in image:
        yield np.asarray(srgb_to_linear(frame[..., :3].cpu().numpy()), np.float32)


def maps(disparity: torch.Tensor) -> np.ndarray:
    """Return an IMAGE or MASK as maps, (frames, H, W); no copy where its channels need not be joined."""
    values = disparity.cpu().numpy()
    if values.ndim == 4:
        same = values.shape[3] == 1 or bool((values[..., :1] == values[..., 1:3]).all())
        values = values[..., 0] if same else values[..., :3] @ _LUMA
    if values.ndim != 3:
        raise ShapeError(f"disparity: expected shape (frames, H, W, 3), got {tuple(disparity.shape)}")
    return values


def frames_of_map(values: np.ndarray, frames: int) -> np.ndarray:
    """Return a map for each frame: one map stands for all."""
    if len(values) not in (1, frames):
        raise ShapeError(f"disparity: expected 1 or {frames} maps, one for each picture, got {len(values)}")
    return np.broadcast_to(values, (frames, *values.shape[1:]))


def mattes(matte: torch.Tensor | None, frames: int) -> list[np.ndarray | None]:
    """Return the matte of each picture from a MASK: one stands for all, none says nothing."""
    if matte is None:
        return [None] * frames
    if matte.ndim != 3 or len(matte) not in (1, frames):
        raise ShapeError(f"matte: expected 1 or {frames} masks of the picture, got {tuple(matte.shape)}")
    return list(np.broadcast_to(matte.cpu().numpy(), (frames, *matte.shape[1:])))


def image_tensor(picture: np.ndarray) -> torch.Tensor:
    """Return scene-linear light as a frame of an IMAGE."""
    return torch.from_numpy(np.asarray(linear_to_srgb(np.clip(picture, 0, 1)), np.float32))


def map_image(values: Any) -> torch.Tensor:
    """Return maps, (frames, H, W), as an IMAGE."""
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))[..., None].expand(-1, -1, -1, 3)
