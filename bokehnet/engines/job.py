"""Job of one render of an engine, and its result."""

from dataclasses import dataclass

import numpy as np

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.base import ClassicalResult
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.engines.coarse_to_fine import CoarseInput
from bokehnet.engines.expected_error import ErrorEstimate
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.tone import GammaCurve
from bokehnet.progress import Progress

__all__ = ["EngineResult", "Job", "Lens", "NetworkInputs"]


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineResult:
    """Rendered picture and its components; all scene-linear float32.

    Attributes:
        bokeh: Result, (H, W, 3).
        classical: Classical half, (H, W, 3); ``None`` if a hybrid was rendered in strips.
        neural: Neural half, (H, W, 3); ``None`` for a classical engine, and in strips.
        error_map: Weight of the neural half, (H, W) in [0, 1]: the learned map within the reach of a depth
            discontinuity, 0 elsewhere; for a classical engine, its geometric error map.
        largest_blur: Largest blur radius, pixels.
        mixed_pixels: Pixels that were rendered as two surfaces, with both; ``None`` for engines that unmix
            none.
        expected_error: Expected mean over colors of |sRGB value - truth|, 8-bit levels, (H, W); ``None`` if
            it was not requested.
    """

    bokeh: np.ndarray
    classical: np.ndarray | None
    neural: np.ndarray | None
    error_map: np.ndarray
    largest_blur: float = 0.0
    mixed_pixels: KnownSurfaces | None = None
    expected_error: np.ndarray | None = None


@dataclass(frozen=True, slots=True)
class Lens:
    """Lens and aperture of one render, with the known edges of the picture."""

    aperture: Aperture
    lens_response: LensResponse
    viewport: Viewport
    pixel_filter: PixelFilter
    known: KnownSurfaces | None = None
    rays_factor: float = 1.0
    layers: Layers | None = None


@dataclass(frozen=True, slots=True)
class NetworkInputs:
    """Inputs of the networks, collected from the whole picture while it is rendered."""

    coarse: CoarseInput | None
    estimate: ErrorEstimate | None

    def add(self, first: int, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult) -> None:
        """Add rows to both."""
        for collector in (self.coarse, self.estimate):
            if collector is not None:
                collector.add(first, image, defocus, classical)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One render: checked image (H, W, 3) and defocus (H, W), optics, tone, progress, inputs of networks."""

    image: np.ndarray
    defocus: np.ndarray
    lens: Lens
    curve: GammaCurve | None
    report: Progress
    network_inputs: NetworkInputs
