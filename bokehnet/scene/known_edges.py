"""Exact edges of a scene, from deep samples, layers or a matte."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_finite, check_map, check_same_size
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces, concatenate_surfaces
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.exr.deep import FlatPixels, two_surfaces
from bokehnet.io.exr.header import is_exr
from bokehnet.io.maps import depth_to_mm, read_map
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import find_picture
from bokehnet.io.window import Window
from bokehnet.optics.coc import disparity_from_depth
from bokehnet.scene.depth.depth_map import SceneLayers
from bokehnet.scene.focus import FocusedLens

__all__ = [
    "check_matte",
    "deep_surfaces",
    "focused_layers",
    "focused_surfaces",
    "matte_surfaces",
    "read_matte",
]

# Minimum coverage that counts.
_MIN_COVERAGE = 1e-4

# Minimum coverage of a pixel that is all foreground, and maximum coverage of one that is all background.
_MIN_FRONT, _MAX_BACK = 0.95, 0.05

# Maximum offset between the edges of the map and those of the matte, pixels.
_MAX_EDGE_OFFSET_PX = 3

# Maximum standard deviation of one side within a window, relative to the difference of both sides, for which
# the side counts as one surface: the mean of a fence and the grass behind it is no surface at all.
_MAX_RELATIVE_DEVIATION = 0.2

# Minimum distance of a map value from the other side, relative to the difference of both sides and in
# addition to the deviation of the other side, to belong to its own side: grass close to a wall is not the
# wall, whatever the matte contains.
_MIN_RELATIVE_DISTANCE = 0.02

# Radii of the search windows for both surfaces of a mixed pixel, pixels.
_SEARCH_RADII_PX = (2, 4, 8, 16, 32)

Array = npt.NDArray[np.float32]


def deep_surfaces(path: Path | str, unit: str = "m") -> KnownSurfaces | None:
    """Return both surfaces of the pixels of a deep picture that show two; None for a flat picture.

    Behind samples that do not cover a pixel the scene is black and infinitely far.

    Args:
        path: EXR file with the picture in a deep part.
        unit: Unit of length of its Z.

    Returns:
        Surfaces whose ``near`` and ``far`` are disparities, 1/mm.

    Examples:
        >>> from bokehnet.io.image import write_image
        >>> write_image("flat.exr", np.ones((4, 6, 3), np.float32))
        >>> deep_surfaces("flat.exr") is None
        True
    """
    if not is_exr(Path(path)):
        return None
    with ImageFile(path) as file:
        picture = find_picture(file)
        if not picture.part.deep:
            return None
        parts = []
        for rows in file.bands(picture.part):
            samples = file.read_deep(picture.part, list(picture.colours), rows)
            layers = two_surfaces(samples, list(picture.colours))
            parts.append(_known_surfaces(layers.front, layers.back, unit).below(rows.start))
    return concatenate_surfaces(parts)


def _known_surfaces(front: FlatPixels, back: FlatPixels, unit: str) -> KnownSurfaces:
    y, x = np.nonzero((front.coverage > _MIN_COVERAGE) & (front.coverage < 1 - _MIN_COVERAGE))
    coverage = front.coverage[y, x]
    near, far = (disparity_from_depth(depth_to_mm(side.depth[y, x][None], unit))[0] for side in (front, back))
    shape = (len(y), 3)  # also for one colour channel
    return KnownSurfaces(
        rows=y,
        columns=x,
        near=near,
        far=np.minimum(near, far),
        coverage=coverage,
        front=np.broadcast_to(front.light[y, x] / coverage[:, None], shape),
        back=np.broadcast_to(back.light[y, x], shape),
        complete=True,
    )


def read_matte(path: Path | str, window: Window) -> Array:
    """Read the coverage of the foreground, (H, W): alpha of a file that has one, else its only channel.

    Args:
        path: Image file.
        window: Position of the picture's pixels in the shown picture.

    Raises:
        ImageFileError: The file cannot be read, or contains NaN or values outside 0 to 1.

    Examples:
        >>> from bokehnet.io.image import write_map
        >>> write_map("matte.exr", np.array([[0, 0.25, 1]], np.float32))
        >>> read_matte("matte.exr", Window.whole(3, 1)).tolist()
        [[0.0, 0.25, 1.0]]
    """
    with ImageFile(path) as file:
        names = [part.alpha for part in file.parts if part.alpha is not None]
    values = read_map(path, names[0] if names else None, window=window)
    bad = int((~np.isfinite(values)).sum())
    if bad or values.min() < 0 or values.max() > 1:
        actual = f"{bad} values that are NaN or infinite" if bad else f"{values.min():g} to {values.max():g}"
        raise ImageFileError(f"{path}: expected a matte of 0 to 1, found {actual}; clip it first")
    return values


def check_matte(matte: npt.NDArray[np.floating], image: Array, name: str = "matte") -> Array:
    """Return a matte (H, W) as float32.

    Raises:
        ShapeError: Its size differs from that of the picture.
        ParameterError: It contains NaN, or values outside 0 to 1.

    Examples:
        >>> check_matte(np.array([[0, 255]]), np.ones((1, 2, 3), np.float32))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: matte: expected 0 to 1, got 0 to 255; clip it first
    """
    check_map(name, matte)
    check_same_size("the picture", image, f"its {name}", matte)
    check_finite(name, matte)
    low, high = float(matte.min()), float(matte.max())
    if low < 0 or high > 1:
        raise ParameterError(name, "0 to 1", shown=f"{low:g} to {high:g}", remedy="clip it first")
    return np.asarray(matte, np.float32)


def matte_surfaces(matte: Array, disparity: Array) -> KnownSurfaces:
    """Return the surfaces of the pixels along the edges of a matte, without their colours.

    Their disparities are means over the nearest pixels that are all foreground and all background, preferably
    farther than three pixels from the edge, the maximum offset of the map's edges. Where these pixels show
    several surfaces, the matte is ignored and the pixel is unmixed like any other. Where the map puts a pixel
    on the side that covers most of it, its own disparity is used for that side, and a pixel entirely of that
    side is skipped. Where the foreground is not the nearer side, the matte marks no depth edge.

    Args:
        matte: Coverage of the foreground, (H, W), 0 to 1.
        disparity: Disparity, or anything that increases with it, (H, W).

    Examples:
        >>> matte = np.array([[0, 0, 0.25, 1, 1]], np.float32)
        >>> known = matte_surfaces(matte, np.array([[0.1, 0.1, 0.1, 0.9, 0.9]], np.float32))
        >>> known.columns.tolist(), known.coverage.tolist(), known.near[0].round(2), known.far[0].round(2)
        ([2], [0.25], np.float32(0.9), np.float32(0.1))
    """
    low, high = local_extremes(matte, _MAX_EDGE_OFFSET_PX)
    y, x = np.nonzero((low < high) | ((matte > 0) & (matte < 1)))
    near, spread = _nearest_mean(disparity, (low >= _MIN_FRONT, matte >= _MIN_FRONT), y, x)
    far, far_spread = _nearest_mean(disparity, (high <= _MAX_BACK, matte <= _MAX_BACK), y, x)
    own, coverage = disparity[y, x], matte[y, x]
    is_front, min_distance = coverage >= 0.5, _MIN_RELATIVE_DISTANCE * (near - far)
    agrees = np.where(is_front, own - far > min_distance + far_spread, near - own > min_distance + spread)
    use_own_near, use_own_far = agrees & is_front, agrees & ~is_front
    near, spread = np.where(use_own_near, own, near), np.where(use_own_near, 0, spread)
    far, far_spread = np.where(use_own_far, own, far), np.where(use_own_far, 0, far_spread)
    known = spread + far_spread <= _MAX_RELATIVE_DEVIATION * (near - far)  # False where either is NaN
    whole = (coverage <= _MAX_BACK) | (coverage >= _MIN_FRONT)
    kept = known & (near > far) & ~(agrees & whole)
    return KnownSurfaces(
        rows=y[kept],
        columns=x[kept],
        near=near[kept].astype(np.float32),
        far=far[kept].astype(np.float32),
        coverage=coverage[kept],
    )


def _nearest_mean(
    values: Array,
    masks: Iterable[npt.NDArray[np.bool_]],
    y: npt.NDArray[np.intp],
    x: npt.NDArray[np.intp],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return mean and deviation of masked values in the smallest window around each pixel with any.

    ``masks``, (H, W) each, are tried in order: the next one serves pixels without any masked value so far.
    The result is NaN where all masks fail.
    """
    mean, deviation = np.full(len(y), np.nan), np.full(len(y), np.nan)
    for mask in masks:
        missing = np.flatnonzero(np.isnan(mean))
        if not len(missing):
            break
        has_any, corners, count = _first_windows(mask, y[missing], x[missing])
        filled = missing[has_any]
        mean[filled] = _window_sums(_table(np.where(mask, values, 0)), corners) / count
        squares = _window_sums(_table(np.where(mask, np.square(values, dtype=np.float64), 0)), corners)
        deviation[filled] = np.sqrt(np.maximum(squares / count - mean[filled] ** 2, 0))
    return mean, deviation


def _first_windows(
    mask: npt.NDArray[np.bool_], y: npt.NDArray[np.intp], x: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.intp], npt.NDArray[np.float64]]:
    """Return a flag per pixel (N,) near the mask, the smallest windows (4, M) that reach it, and counts."""
    height, width = mask.shape
    table = _table(mask)
    has_any, corners, count = np.zeros(len(y), bool), np.zeros((4, len(y)), np.intp), np.zeros(len(y))
    for radius in _SEARCH_RADII_PX:
        pending = np.flatnonzero(~has_any)
        top, bottom = np.maximum(y[pending] - radius, 0), np.minimum(y[pending] + radius + 1, height)
        left, right = np.maximum(x[pending] - radius, 0), np.minimum(x[pending] + radius + 1, width)
        corners[:, pending] = top, bottom, left, right
        count[pending] = _window_sums(table, corners[:, pending])
        has_any = count > 0.5
    return has_any, corners[:, has_any], count[has_any]


def _table(values: npt.NDArray[np.generic]) -> npt.NDArray[np.float64]:
    """Return the summed-area table of values (H, W), (H+1, W+1)."""
    return np.pad(values.cumsum(0, dtype=np.float64).cumsum(1), ((1, 0), (1, 0)))


def _window_sums(table: npt.NDArray[np.float64], corners: npt.NDArray[np.intp]) -> npt.NDArray[np.float64]:
    """Return the sums over windows from a summed-area table, given top, bottom, left and right."""
    top, bottom, left, right = corners
    return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]


def focused_surfaces(
    known: KnownSurfaces | None, values: Array, lens: FocusedLens | None, factor: int = 1
) -> KnownSurfaces | None:
    """Return the surfaces with blur radii in pixels in place of disparities.

    Args:
        known: Surfaces in the unit of the map.
        values: Depth map, (H, W).
        lens: Lens with its focus; None if the map contains blur radii.
        factor: Factor on such blur radii.

    Examples:
        >>> edge = matte_surfaces(np.array([[0, 0.5, 1]], np.float32), np.array([[-2, 3, 3]], np.float32))
        >>> focused_surfaces(edge, np.zeros((1, 3), np.float32), None, 2).near.tolist()
        [6.0]
    """
    if known is None or not len(known.rows):
        return known
    if lens is None:
        return replace(known, near=known.near * factor, far=known.far * factor)
    near, far = (lens.defocus(side)[known.rows, known.columns] for side in known.near_and_far_maps(values))
    return replace(known, near=near, far=np.minimum(near, far))


def focused_layers(layers: SceneLayers | None, lens: FocusedLens | None) -> Layers | None:
    """Return the layers with blur radii in pixels, for engine rays.

    Args:
        layers: Layers in the unit of the map.
        lens: Lens with its focus.

    Examples:
        >>> focused_layers(None, None) is None
        True
    """
    if layers is None or lens is None:
        return None
    radii = [lens.defocus(layers.values[:, :, layer]) for layer in range(layers.values.shape[2])]
    defocus = np.minimum.accumulate(np.stack(radii, 2), axis=2)
    return Layers(colors=layers.colors, defocus=defocus, coverage=layers.coverage)
