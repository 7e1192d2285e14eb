"""Interface between the nodes and ComfyUI: tensors, progress, cancellation, one-line errors."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import comfy.model_management
import comfy.utils
import numpy as np
import torch
from PIL import Image

from bokehnet.errors import BokehnetError, RenderCancelled, ShapeError
from bokehnet.io.color.color_space import SRGB
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.frame import Frame
from bokehnet.scene.scene import Scene

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
    "node_errors",
    "photograph",
]

CATEGORY = "bokehnet"

# Luma weights for colour maps, whose channels are equal, or nearly so after lossy compression.
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


class NodeError(Exception):
    """One-line error that ComfyUI shows at the node."""


class Cancel:
    """Cancellation flag that is set if the user has pressed cancel."""

    def is_set(self) -> bool:
        """Return whether ComfyUI interrupts processing."""
        return bool(comfy.model_management.processing_interrupted())


@contextmanager
def node_errors() -> Iterator[None]:
    """Convert errors of the package to one line at the node, and a cancelled rendering to ComfyUI's own."""
    try:
        yield
    except RenderCancelled:
        comfy.model_management.throw_exception_if_processing_interrupted()
        raise
    except BokehnetError as error:
        raise NodeError(" ".join(str(error).split())) from None


class FrameBar:
    """Progress bar of the node over all steps of all frames, with each finished frame as preview.

    Args:
        frames: Number of frames.
        parts: Number of steps per frame.
    """

    _STEPS, _MAX_PREVIEW_PX = 1000, 512

    def __init__(self, frames: int, parts: int) -> None:
        self._parts = parts
        self._bar = comfy.utils.ProgressBar(frames * parts * self._STEPS)

    def part(self, frame: int, part: int) -> Callable[[int, int], None]:
        """Return the progress callback of one step of a frame."""
        begin = (frame * self._parts + part) * self._STEPS

        def report(done: int, total: int) -> None:
            self._bar.update_absolute(begin + self._STEPS * done // max(total, 1))

        return report

    def show(self, frame: int, picture: torch.Tensor) -> None:
        """Show a finished frame, (H, W, 3) as in an IMAGE."""
        preview = Image.fromarray((picture * 255 + 0.5).to(torch.uint8).numpy())
        self._bar.update_absolute(
            (frame + 1) * self._parts * self._STEPS, None, ("JPEG", preview, self._MAX_PREVIEW_PX)
        )


def light(image: torch.Tensor) -> Iterator[np.ndarray]:
    """Yield the frames of an IMAGE as scene-linear light, (H, W, 3)."""
    if image.ndim != 4 or image.shape[3] not in (3, 4):
        raise ShapeError(f"image: expected shape (frames, H, W, 3), got {tuple(image.shape)}")
    for frame in image:
        yield np.asarray(srgb_to_linear(frame[..., :3].cpu().numpy()), np.float32)


def photograph(scene: Scene) -> Scene:
    """Return a scene whose picture counts as display-referred, so that its clipped light is recovered."""
    frame = Frame(image=scene.image, alpha=None, camera=None, window=scene.window, space=SRGB, bits=8)
    return replace(scene, frame=frame)


def maps(disparity: torch.Tensor) -> np.ndarray:
    """Return an IMAGE or MASK as maps, (frames, H, W); copies only if channels must be combined."""
    values = disparity.cpu().numpy()
    if values.ndim == 4:
        same = values.shape[3] == 1 or bool((values[..., :1] == values[..., 1:3]).all())
        values = values[..., 0] if same else values[..., :3] @ _LUMA
    if values.ndim != 3:
        raise ShapeError(f"disparity: expected shape (frames, H, W, 3), got {tuple(disparity.shape)}")
    return values


def frames_of_map(values: np.ndarray, frames: int) -> np.ndarray:
    """Return a map for each frame; a single map applies to all frames."""
    if len(values) not in (1, frames):
        raise ShapeError(f"disparity: expected 1 or {frames} maps, one for each picture, got {len(values)}")
    return np.broadcast_to(values, (frames, *values.shape[1:]))


def mattes(matte: torch.Tensor | None, frames: int) -> list[np.ndarray | None]:
    """Return the matte of each picture from a MASK; a single mask applies to all pictures, None to none."""
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
