"""Scatter of NumPy arrays on a torch device."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.base import check_inputs
from bokehnet.classical.scatter.disc_scatter import LARGEST_RADIUS
from bokehnet.classical.torch.pyramid_levels import scatter_sums
from bokehnet.optics.aperture import Aperture

__all__ = ["cuda_unavailable_reason", "scatter_on"]


def cuda_unavailable_reason() -> str | None:
    """Return the reason why torch cannot use a CUDA device, or None if it can."""
    if torch.version.cuda is None and torch.version.hip is None:
        return f"a torch without CUDA, {torch.__version__}"
    try:
        torch.zeros(1, device="cuda")
    except (AssertionError, RuntimeError) as error:
        return str(error).splitlines()[0]
    return None


def scatter_on(device: str) -> Callable[..., Any]:
    """Return :func:`bokehnet.classical.scatter_renderer.scatter_inside` for a torch device.

    Args:
        device: Device, such as ``cuda``. ``cpu`` runs the same operations, slowly, for tests.

    Examples:
        >>> picture = np.random.default_rng(0).random((9, 12, 3), np.float32)
        >>> bokeh = scatter_on("cpu")(picture, np.full((9, 12), 3, np.float32))
        >>> bokeh.shape, bokeh.dtype
        ((9, 12, 3), dtype('float32'))
    """

    def scatter(
        image: np.ndarray,
        defocus: np.ndarray,
        aperture: Aperture | None = None,
        viewport: Viewport | None = None,
    ) -> np.ndarray:
        light, radii = check_inputs(image, defocus)
        with torch.no_grad():
            picture = torch.from_numpy(light).to(device)
            blur = torch.from_numpy(radii).to(picture).clamp(-LARGEST_RADIUS, LARGEST_RADIUS)
            values = torch.cat([picture, torch.ones_like(picture[..., :1])], -1)
            sums = scatter_sums(values, blur, aperture, viewport)
            weight = sums[..., -1:]
            lit = weight > 0
            bokeh = torch.where(lit, sums[..., :-1] / torch.where(lit, weight, 1.0), picture)
        return bokeh.cpu().numpy()

    return scatter
