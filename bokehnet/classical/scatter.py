"""The scatter renderer: every pixel spreads over its disc, the sums are normalised."""

import numpy as np

from bokehnet.classical.base import ClassicalResult, check_inputs
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.kernels import scatter_forward

__all__ = ["render_scatter", "scatter"]


def scatter(image: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Render bokeh by scattering, blind to occlusion.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32 or float64.
        defocus: Signed blur radius in pixels, (H, W).

    Returns:
        Picture of the same shape and dtype. Pixels with |defocus| <= 0.5 that no neighbour reaches keep
        their value; picture borders are not darkened.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022, for the
        normalised scatter; the disc's weights are described in :mod:`bokehnet.classical.kernels`.
    """
    total, weight = scatter_forward(*check_inputs(image, defocus))
    return np.asarray(total / weight[..., None])


def render_scatter(image: np.ndarray, defocus: np.ndarray) -> ClassicalResult:
    """Scatter, with the geometric error map beside it; arguments and errors of :func:`scatter`."""
    return ClassicalResult(bokeh=scatter(image, defocus), error_map=geometric_error_map(defocus))
