"""Peeled scenes as layered EXR files and as layers for the classical rays renderer."""

from pathlib import Path

import numpy as np

from bokehnet.classical.layered.layers import Layers
from bokehnet.io.channels import write_channels
from bokehnet.lenses import LensModel
from bokehnet.raytrace.peeling import Peeled

__all__ = ["layers_from", "save_layers"]

_MM_PER_M = 1000.0


def layers_from(peeled: Peeled, lens: LensModel, pixel_pitch: float) -> Layers:
    """Return what ``bokehnet.rays(..., layers=...)`` takes.

    Args:
        peeled: From :func:`bokehnet.raytrace.peeling.peel`.
        lens: The lens whose blur is wanted.
        pixel_pitch: Distance between the centres of two pixels, mm.
    """
    disparity = 1 / peeled.depth.cpu().numpy().astype(np.float64)
    return Layers(
        colors=peeled.colors.cpu().numpy(),
        defocus=lens.coc_radius(disparity) / pixel_pitch,
        coverage=peeled.coverage.cpu().numpy().clip(0, 1),
    )


def save_layers(path: Path, peeled: Peeled) -> None:
    """Write ``layer1.R``, ``.G``, ``.B``, ``.Z`` (m) and ``.coverage``, ``layer2.R`` ... as EXR, atomically.

    Raises:
        ImageFileError: The file cannot be written.
    """
    channels = {}
    for index in range(peeled.depth.shape[2]):
        prefix = f"layer{index + 1}."
        for place, name in enumerate("RGB"):
            channels[prefix + name] = peeled.colors[:, :, index, place].cpu().numpy()
        channels[prefix + "Z"] = peeled.depth[:, :, index].cpu().numpy() / _MM_PER_M
        channels[prefix + "coverage"] = peeled.coverage[:, :, index].cpu().numpy()
    write_channels(path, channels)
