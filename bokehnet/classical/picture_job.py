"""Job of the rays renderer: picture, options, and the part of the picture that is rendered."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.base import Strip, with_halo
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.resolution_levels import layers_halo
from bokehnet.classical.scatter_renderer import scatter_inside
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["CPU", "MIN_HALO_PX", "Device", "PictureJob", "output_halo"]

# Minimum halo around the output beyond the reach of light, pixels, for averaging windows.
MIN_HALO_PX = 32


class Device(NamedTuple):
    """Functions that scatter and march on a device.

    Attributes:
        scatter: Same signature as :func:`bokehnet.classical.scatter_renderer.scatter_inside`.
        march: Kernel that sends rays, see ``send`` of
            :func:`bokehnet.classical.layered.march.ray_marching.march`; ``None`` for the kernel on the CPU.
    """

    scatter: Callable[..., np.ndarray]
    march: Callable[..., None] | None


CPU = Device(scatter_inside, None)


def output_halo(reach: int) -> int:
    """Return the pixels around an output whose layers it depends on, for rays with this reach, pixels."""
    return reach + max(MIN_HALO_PX, layers_halo(reach))


@dataclass(frozen=True, kw_only=True, slots=True)
class PictureJob:
    """Picture and options of one render; options as in :class:`bokehnet.classical.base.ClassicalOptions`."""

    image: np.ndarray
    defocus: np.ndarray
    aperture: Aperture
    lens_response: LensResponse | None = None
    seed: int = 0
    layers: Layers | None = None
    strip: Strip | None = None
    viewport: Viewport | None = None
    progress: Callable[[float], None] | None = None
    pixel_filter: PixelFilter = DEFAULT_FILTER
    known: KnownSurfaces | None = None
    rays_factor: float = 1.0
    device: Device = CPU

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the whole picture, of which the arrays may be a part."""
        height, width = self.defocus.shape
        return (height, width) if self.strip is None else self.strip.size

    @property
    def above(self) -> int:
        """Rows of the picture above the arrays."""
        return 0 if self.strip is None else self.strip.first

    @property
    def picture_viewport(self) -> Viewport:
        """Position in the shown picture of the whole one, without the columns left of the arrays."""
        whole = self.viewport or Viewport.whole(*self.size)
        return whole if self.strip is None else replace(whole, left=whole.left + self.strip.left)

    def reached(self) -> tuple[slice, slice]:
        """Return the rows and columns of the arrays that rays of the output, and its light, can reach.

        Their surroundings serve only to estimate what they occlude.
        """
        height, width = self.defocus.shape
        if self.strip is None:
            return slice(0, height), slice(0, width)
        halo = output_halo(self.strip.max_ray_reach)
        rows, columns = self.strip.output
        return with_halo(rows, halo, height), with_halo(columns, halo, width)

    def cropped(self, rows: slice, columns: slice) -> "PictureJob":
        """Return the job of some rows and columns, slices with both ends; only with a strip."""
        assert self.strip is not None
        image, defocus = (np.ascontiguousarray(array[rows, columns]) for array in (self.image, self.defocus))
        return replace(
            self,
            image=image,
            defocus=defocus,
            known=self.known and self.known.part(rows, columns),
            layers=self.layers and self.layers.part(rows, columns),
            strip=self.strip.cropped(rows, columns),
        )
