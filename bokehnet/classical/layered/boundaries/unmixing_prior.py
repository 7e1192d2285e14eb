"""Prior assumptions of the unmixing of pixels at depth discontinuities."""

from typing import NamedTuple

__all__ = ["PRIOR"]


class _Prior(NamedTuple):
    """Prior assumptions of the unmixing.

    Attributes:
        coverage_sigma: Standard deviation of the coverage.
        window_px: Half-width of the window for the initial colors, pixels.
        window_variance: Squared deviation of its weights, square pixels.
        mixed_weight: Weight of mixed pixels in it.
        iterations: Number of iterations before edges are located.
        neighbour_variance: Squared deviation of the weights of the 3x3 pixels, square pixels.
        min_weight: Weight, in addition to the squared coverage, of a surface that covers little of a pixel.
        min_relative_sigma: Minimum deviation of colors as a fraction of them.
        min_sigma: Absolute minimum deviation of colors.
        edge_window_px: Half-width of the window in which edges are located together, pixels.
        edge_window_variance: Squared deviation of its weights, square pixels.
        edge_contrast: Squared color difference at which the weight of a pixel is one half.
        edge_prior_weight: Weight of the position of an edge in the map.
        min_edge_slope: Minimum derivative of a coverage by the edge position.
        located_sigma: Replaces ``coverage_sigma`` after edges are located.
        located_iterations: Number of iterations after edges are located.
        min_pure_pixels: Pure pixels in the window from which on the variance of a surface is known.
        max_variance_ratio: Maximum variance of unmixed pixels over that of the pure pixels.
    """

    coverage_sigma: float
    window_px: int
    window_variance: float
    mixed_weight: float
    iterations: int
    neighbour_variance: float
    min_weight: float
    min_relative_sigma: float
    min_sigma: float
    edge_window_px: int
    edge_window_variance: float
    edge_contrast: float
    edge_prior_weight: float
    min_edge_slope: float
    located_sigma: float
    located_iterations: int
    min_pure_pixels: int
    max_variance_ratio: float


PRIOR = _Prior(
    coverage_sigma=0.1,
    window_px=3,
    window_variance=4.0,
    mixed_weight=0.35,
    iterations=8,
    neighbour_variance=2.0,
    min_weight=0.1,
    min_relative_sigma=0.02,
    min_sigma=1e-4,
    edge_window_px=2,
    edge_window_variance=4.0,
    edge_contrast=1e-3,
    edge_prior_weight=0.18,
    min_edge_slope=0.02,
    located_sigma=0.07,
    located_iterations=4,
    min_pure_pixels=12,
    max_variance_ratio=10.0,
)
