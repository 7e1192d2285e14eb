"""Films: traced pictures as EXR files from which tracing can resume."""

import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from bokehnet.errors import ImageFileError
from bokehnet.io.channels import read_channels, write_channels
from bokehnet.raytrace.tracer import Accumulation, Maps

__all__ = ["load_film", "save_film"]

_MM_PER_M = 1000.0
_SAMPLES, _SCENE, _BODIES = "bokehnet:samples", "bokehnet:scene", "bokehnet:bodies"


def save_film(path: Path, film: Accumulation, maps: Maps, digest: str, names: list[str]) -> None:
    """Write the state of a traced picture.

    ``R``, ``G``, ``B`` are the bokeh, ``all_in_focus.*`` the sharp picture, ``Z`` depth in m, ``disparity``
    in 1/m, ``normal.X``, ``.Y``, ``.Z`` normals in the axes of the scene, ``id`` the number of the body from
    1, 0 for none, and ``coverage``. Attributes hold the number of samples and the names of the bodies; after
    adaptive sampling, ``samples`` and ``variance`` hold those of the film.

    Args:
        path: EXR file; replaced atomically.
        film: Means over the samples so far.
        maps: Geometry maps, with depths along the normal of the sensor (:meth:`SceneJob.sensor_depth`).
        digest: Digest that identifies the scene.
        names: Names of the bodies.

    Raises:
        ImageFileError: The file cannot be written.
    """
    depth = maps.depth.cpu().numpy().astype(np.float64) / _MM_PER_M
    channels = {
        **_split("", film.bokeh, "RGB"),
        **_split("all_in_focus.", film.all_in_focus, "RGB"),
        **_split("normal.", maps.normal, "XYZ"),
        "Z": depth,
        "disparity": 1 / depth,
        "id": maps.body.cpu().numpy() + 1,
        "coverage": film.coverage.cpu().numpy(),
    }
    if film.counts is not None and film.variance is not None:
        channels |= {"samples": film.counts.cpu().numpy(), "variance": film.variance.cpu().numpy()}
    attributes = {_SAMPLES: str(film.samples), _SCENE: digest, _BODIES: json.dumps(names)}
    write_channels(path, channels, attributes)


def load_film(path: Path, digest: str, device: torch.device | str = "cpu") -> Accumulation:
    """Read the state of a traced picture.

    Args:
        path: File of :func:`save_film`.
        digest: Digest of the scene to resume.
        device: Device that resumes.

    Raises:
        ImageFileError: The file cannot be read, or is of another scene.
    """
    file = read_channels(path)
    if file.attributes.get(_SCENE) != digest:
        raise ImageFileError(
            f"{path}: exists and is not of this scene, size and seed; remove it, or restart with --fresh"
        )

    def load(prefix: str, names: str) -> Tensor:
        stack = np.stack([file.channels[prefix + name] for name in names], -1)
        return torch.from_numpy(stack).to(device)

    adaptive = {
        name: torch.from_numpy(file.channels[name]).to(device)
        for name in ("samples", "variance")
        if name in file.channels
    }
    return Accumulation(
        bokeh=load("", "RGB"),
        all_in_focus=load("all_in_focus.", "RGB"),
        coverage=torch.from_numpy(file.channels["coverage"]).to(device),
        samples=int(file.attributes[_SAMPLES]),
        counts=adaptive["samples"].long() if adaptive else None,
        variance=adaptive.get("variance"),
    )


def _split(prefix: str, values: Tensor, names: str) -> dict[str, np.ndarray]:
    """Return the channels of a picture (H, W, 3) by name."""
    return {prefix + name: values[..., index].cpu().numpy() for index, name in enumerate(names)}
