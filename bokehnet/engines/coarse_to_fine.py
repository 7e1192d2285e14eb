"""Correction by the networks: ARNet's alone, computed once on a small copy of the picture; or level by level.

Without an IUNet the formulas and the result are those of
:func:`bokehnet.inference.coarse_to_fine.render_neural`. But there are no levels: only the small arrays are
kept and then applied to any rows of the picture, and only pixels where the classical render can be wrong are
processed at full size.
"""

from dataclasses import dataclass

import numpy as np
from numba import prange

from bokehnet.arrays.fusion import fuse
from bokehnet.arrays.pyramid import count_halvings, upsample2
from bokehnet.classical.base import ClassicalResult
from bokehnet.classical.parallel import parallel_region
from bokehnet.engines.small_copy import SmallCopy
from bokehnet.engines.tiling import refine_in_tiles
from bokehnet.inference.coarse_to_fine import (
    apply_change,
    encoded_change,
    render_neural,
    run_arnet,
    suppress_foreground_outlines,
)
from bokehnet.inference.session import Networks
from bokehnet.kernels import njit

__all__ = [
    "ARNET_BYTES",
    "MAX_NETWORK_PIXELS",
    "MIN_NETWORK_PIXELS",
    "CoarseCorrection",
    "CoarseInput",
    "CorrectedRows",
    "correct_level_by_level",
]

# Memory per pixel that ARNet sees, bytes; maximum number of pixels that it sees, and lower bound of that
# maximum if memory is bounded.
ARNET_BYTES, MAX_NETWORK_PIXELS, MIN_NETWORK_PIXELS = 1100, 2_200_000, 2**18

# Small pixels around a row range on which its doubling depends.
_MARGIN = 2


@dataclass(frozen=True, kw_only=True, slots=True)
class CorrectedRows:
    """Rows of a picture, scene-linear: the blend, (H, W, 3), its neural half, and the error map, (H, W)."""

    bokeh: np.ndarray
    neural: np.ndarray
    error_map: np.ndarray


@njit(cache=True, parallel=True)
def _double_at(values, rows, columns):
    """Return the bilinear doubling of (h, w, C) at some pixels only, (N, C)."""
    height, width, channels = values.shape
    result = np.empty((rows.size, channels), np.float32)
    for i in prange(rows.size):
        y, x = rows[i] // 2, columns[i] // 2
        v = min(max(y + (1 if rows[i] % 2 else -1), 0), height - 1)
        u = min(max(x + (1 if columns[i] % 2 else -1), 0), width - 1)
        for c in range(channels):
            near = 0.75 * values[y, x, c] + 0.25 * values[y, u, c]
            far = 0.75 * values[v, x, c] + 0.25 * values[v, u, c]
            result[i, c] = 0.75 * near + 0.25 * far
    return result


@dataclass(frozen=True, kw_only=True, slots=True)
class CoarseCorrection:
    """Correction of a picture by ARNet.

    Attributes:
        values: Change of the encoded colors, error map and, if the classical renderer leaves outlines,
            its render and the defocus: (h, w, 4 or 8), at the size of the small copy.
        halvings: Number of halvings from the picture to the small copy.
    """

    values: np.ndarray
    halvings: int

    def apply(
        self, classical: np.ndarray, classical_error_map: np.ndarray, defocus: np.ndarray, first: int = 0
    ) -> CorrectedRows:
        """Correct rows of a picture where the classical render can be wrong; the others stay unchanged.

        Args:
            classical: Classical render, scene-linear, (H, W, 3).
            classical_error_map: The classical renderer's own error map, (H, W).
            defocus: Signed blur radius in pixels of the picture, (H, W).
            first: Row of the picture at which the arrays begin.
        """
        rows, columns = np.nonzero(classical_error_map)
        light, values = classical[rows, columns], self._at(rows + first, columns)
        blend = values[:, 3] * classical_error_map[rows, columns]
        if values.shape[1] > 4:
            radius = defocus[rows, columns, None] / np.float32(2**self.halvings)
            light, suppressed_blend = suppress_foreground_outlines(
                light, radius, values[:, 4:7], values[:, 7:], blend[:, None]
            )
            blend = suppressed_blend[:, 0]
        corrected = apply_change(light, values[:, :3])
        bokeh, neural, error_map = classical.copy(), classical.copy(), np.zeros_like(classical_error_map)
        bokeh[rows, columns] = fuse(light, corrected, blend[:, None])
        neural[rows, columns], error_map[rows, columns] = corrected, blend
        return CorrectedRows(bokeh=bokeh, neural=neural, error_map=error_map)

    def _at(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the values at pixels of the picture, (N, 4 or 8)."""
        if self.halvings == 0 or not len(rows):
            return self.values[rows, columns]
        factor = 2**self.halvings
        top = max(0, int(rows[0]) // factor - _MARGIN)
        values = self.values[top : int(rows[-1]) // factor + 1 + _MARGIN].transpose(2, 0, 1)
        for _ in range(self.halvings - 1):
            values = upsample2(values)
        half = np.ascontiguousarray(values.transpose(1, 2, 0))
        with parallel_region:
            doubled: np.ndarray = _double_at(half, rows - top * factor, columns)
        return doubled


class CoarseInput:
    """Input of ARNet: picture, defocus, classical render and features, at a size at which no blur is large.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        max_coc_radius: Largest blur radius of the picture, pixels.
        network_max_radius: Largest radius in the training of ARNet, pixels.
        max_pixels: Maximum number of pixels that ARNet sees; the picture is halved until it has no more.
    """

    def __init__(
        self,
        height: int,
        width: int,
        max_coc_radius: float,
        network_max_radius: float,
        max_pixels: int = MAX_NETWORK_PIXELS,
    ) -> None:
        halvings = count_halvings(max_coc_radius, network_max_radius)
        self._small = SmallCopy(height, width, halvings, max_pixels)

    def add(self, first: int, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult) -> None:
        """Add rows of the picture.

        Args:
            first: Row of the picture at which the arrays begin; a multiple of ``2**halvings``.
            image: Scene-linear picture, (H, W, 3).
            defocus: Signed blur radius in pixels, (H, W).
            classical: Classical render of these rows.
        """
        arrays = {"image": image, "defocus": defocus[..., None], "classical": classical.bokeh}
        if classical.occluded_background is not None and classical.disocclusion_weight is not None:
            arrays["occluded_background"] = classical.occluded_background
            arrays["disocclusion_weight"] = classical.disocclusion_weight[..., None]
            arrays["classical_error_map"] = classical.error_map[..., None]
        self._small.add(first, arrays)

    def correct(self, networks: Networks) -> CoarseCorrection:
        """Run ARNet, after all rows are added."""
        batch, halvings = self._small.batch(), self._small.halvings
        names = ("occluded_background", "disocclusion_weight", "classical_error_map")
        features = [batch[name] for name in names if name in batch]
        bokeh, learned = run_arnet(
            networks.arnet,
            batch["image"],
            batch["defocus"],
            batch["classical"],
            np.concatenate(features, axis=1) if features else None,
            networks.max_valid_radius / 2**halvings,
        )
        change = encoded_change(bokeh[0], batch["classical"][0])
        extra = [batch["classical"][0], batch["defocus"][0]] if networks.leaves_outlines else []
        values = np.concatenate([change, learned[0], *extra]).transpose(1, 2, 0)
        return CoarseCorrection(values=np.ascontiguousarray(values), halvings=halvings)


def _to_batch(array: np.ndarray) -> np.ndarray:
    """Reshape (H, W) or (H, W, C) to (1, C, H, W)."""
    return np.ascontiguousarray(np.atleast_3d(array).transpose(2, 0, 1)[None])


def correct_level_by_level(
    networks: Networks, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult
) -> CorrectedRows:
    """Correct with an IUNet: at all sizes up to full size, in tiles.

    Args:
        networks: ARNet and IUNet.
        image: Scene-linear picture, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        classical: Classical render.
    """
    batches = [_to_batch(x) for x in (image, defocus, classical.bokeh, classical.error_map)]
    result = render_neural(
        *batches,
        features=None if classical.features is None else _to_batch(classical.features),
        arnet=networks.arnet,
        iunet=networks.iunet,
        network_max_radius=networks.network_max_radius,
        max_valid_radius=networks.max_valid_radius,
        refine=refine_in_tiles,
        leaves_outlines=networks.leaves_outlines,
    )
    bokeh, neural = (np.ascontiguousarray(x[0].transpose(1, 2, 0)) for x in (result.bokeh, result.picture))
    return CorrectedRows(bokeh=bokeh, neural=neural, error_map=result.error_map[0, 0])
