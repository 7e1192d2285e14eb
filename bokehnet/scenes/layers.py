"""Peeled scenes as layered EXR files."""

from pathlib import Path

from bokehnet.io.channels import write_channels
from bokehnet.optics.pixels.over import transmittance
from bokehnet.raytrace.peeling import Peeled

__all__ = ["save_layers"]

_MM_PER_M = 1000.0


def save_layers(path: Path, peeled: Peeled) -> None:
    """Write ``layer1.R``, ``.G``, ``.B``, ``.Z`` (m) and ``.coverage``, ``layer2.R`` ... as EXR, atomically.

    ``R``, ``G`` and ``B`` are the composite of all layers.

    Raises:
        ImageFileError: The file cannot be written.
    """
    visibility = transmittance(peeled.coverage)[1] * peeled.coverage
    flat = (visibility[..., None] * peeled.colors).sum(2).cpu().numpy()
    channels = {name: flat[:, :, channel] for channel, name in enumerate("RGB")}
    for index in range(peeled.depth.shape[2]):
        prefix = f"layer{index + 1}."
        for channel, name in enumerate("RGB"):
            channels[prefix + name] = peeled.colors[:, :, index, channel].cpu().numpy()
        channels[prefix + "Z"] = peeled.depth[:, :, index].cpu().numpy() / _MM_PER_M
        channels[prefix + "coverage"] = peeled.coverage[:, :, index].cpu().numpy()
    write_channels(path, channels)
