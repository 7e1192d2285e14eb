"""What a scene tells of its edges besides colours and depth: by deep samples, or by a matte or alpha."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_finite, check_map, check_same_size
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces, concatenate_surfaces
from bokehnet.depth_repair.stages.edge_sharpening import extremes
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.exr.deep import FlatPixels, two_surfaces
from bokehnet.io.exr.header import is_exr
from bokehnet.io.maps import depth_to_mm, read_map
from bokehnet.io.picture import find_picture
from bokehnet.io.pixels import ImageFile
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

# Coverage that is as good as none.
_LEAST = 1e-4

# From here on, and up to here, a matte says that a pixel is all front, and all back.
_FRONT, _BACK = 0.95, 0.05

# Pixels by which the edges of the map may lie beside those of the matte.
_MARGIN = 3

# Standard deviation of what a window shows of a side, over the step to the other side, up to which it is one
# surface: the mean of a fence and of the grass behind it lies where nothing is.
_ONE_SURFACE = 0.2

# Share of that step, and beside it what the other side deviates, by which a pixel of the map has to lie off
# the other side to be on its own: grass close before a wall is not the wall, whatever else the matte holds.
_OFF = 0.02

# Half the widths of the windows in which a mixed pixel of a matte looks for both surfaces, pixels.
_REACHES = (2, 4, 8, 16, 32)

Array = npt.NDArray[np.float32]


def deep_surfaces(path: Path | str, unit: str = "m") -> KnownSurfaces | None:
    """Both surfaces of the pixels of a deep picture that show two; None where the picture is flat.

    Where the samples of a pixel do not cover it, nothing stands behind them: black, infinitely far.

    Args:
        path: An EXR file whose picture is in a deep part.
        unit: Of its Z, a unit of length.

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
            parts.append(_parted(layers.front, layers.back, unit).below(rows.start))
    return concatenate_surfaces(parts)


def _parted(front: FlatPixels, back: FlatPixels, unit: str) -> KnownSurfaces:
    y, x = np.nonzero((front.coverage > _LEAST) & (front.coverage < 1 - _LEAST))
    coverage = front.coverage[y, x]
    near, far = (disparity_from_depth(depth_to_mm(side.depth[y, x][None], unit))[0] for side in (front, back))
    shape = (len(y), 3)  # of one colour channel, too
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
    """Read the coverage of the front, (H, W): the alpha of a file that has one, else its only channel.

    Args:
        path: An image file.
        window: Where the pixels of the picture lie.

    Raises:
        ImageFileError: The file cannot be read, or holds NaN or values outside 0 to 1.

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
        found = f"{bad} values that are NaN or infinite" if bad else f"{values.min():g} to {values.max():g}"
        raise ImageFileError(f"{path}: expected a matte of 0 to 1, found {found}; clip it first")
    return values


def check_matte(matte: npt.NDArray[np.floating], image: Array, name: str = "matte") -> Array:
    """Return a matte (H, W) as float32.

    Raises:
        ShapeError: It has another size than its picture.
        ParameterError: NaN, or values outside 0 to 1.

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
    """Surfaces of the pixels along the edges of a matte, of which only the colours are not known.

    Their disparities are means over the nearest pixels that are all front and all back, if there are any
    farther than three pixels from the edge: so far the edges of the map may lie beside it, and so far what
    is all front or all back is told as well. Where these show several surfaces, the matte tells nothing and
    the pixel is left to be unmixed as any other. Where the map has a pixel on the side that fills most of it,
    its own disparity is that side's, and a pixel that is all of that side is left alone. Where the front is
    not the nearer of both, the matte is of no edge in depth.

    Args:
        matte: Coverage of the front, (H, W), 0 to 1.
        disparity: Or anything that grows with it, (H, W).

    Examples:
        >>> matte = np.array([[0, 0, 0.25, 1, 1]], np.float32)
        >>> found = matte_surfaces(matte, np.array([[0.1, 0.1, 0.1, 0.9, 0.9]], np.float32))
        >>> found.columns.tolist(), found.coverage.tolist(), found.near[0].round(2), found.far[0].round(2)
        ([2], [0.25], np.float32(0.9), np.float32(0.1))
    """
    low, high = extremes(matte, _MARGIN)
    y, x = np.nonzero((low < high) | ((matte > 0) & (matte < 1)))
    near, spread = _nearest_mean(disparity, (low >= _FRONT, matte >= _FRONT), y, x)
    far, far_spread = _nearest_mean(disparity, (high <= _BACK, matte <= _BACK), y, x)
    own, share = disparity[y, x], matte[y, x]
    is_front, step = share >= 0.5, _OFF * (near - far)
    agrees = np.where(is_front, own - far > step + far_spread, near - own > step + spread)
    by_map, by_map_far = agrees & is_front, agrees & ~is_front
    near, spread = np.where(by_map, own, near), np.where(by_map, 0, spread)
    far, far_spread = np.where(by_map_far, own, far), np.where(by_map_far, 0, far_spread)
    known = spread + far_spread <= _ONE_SURFACE * (near - far)  # not where either is NaN
    whole = (share <= _BACK) | (share >= _FRONT)
    kept = known & (near > far) & ~(agrees & whole)
    return KnownSurfaces(
        rows=y[kept],
        columns=x[kept],
        near=near[kept].astype(np.float32),
        far=far[kept].astype(np.float32),
        coverage=share[kept],
    )


def _nearest_mean(
    values: Array,
    wanted: Iterable[npt.NDArray[np.bool_]],
    y: npt.NDArray[np.intp],
    x: npt.NDArray[np.intp],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Mean and deviation of the wanted values in the smallest window around each pixel that holds any.

    ``wanted`` are masks (H, W), the next one for pixels around which the last one holds none; NaN for none.
    """
    mean, deviation = np.full(len(y), np.nan), np.full(len(y), np.nan)
    for mask in wanted:
        missing = np.flatnonzero(np.isnan(mean))
        if not len(missing):
            break
        there, corners, count = _first_windows(mask, y[missing], x[missing])
        found = missing[there]
        mean[found] = _window_sums(_table(np.where(mask, values, 0)), corners) / count
        squares = _window_sums(_table(np.where(mask, np.square(values, dtype=np.float64), 0)), corners)
        deviation[found] = np.sqrt(np.maximum(squares / count - mean[found] ** 2, 0))
    return mean, deviation


def _first_windows(
    mask: npt.NDArray[np.bool_], y: npt.NDArray[np.intp], x: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.intp], npt.NDArray[np.float64]]:
    """Which pixels (N,) see any of the mask, the smallest windows (4, M) in which they do, and how many."""
    height, width = mask.shape
    table = _table(mask)
    there, corners, count = np.zeros(len(y), bool), np.zeros((4, len(y)), np.intp), np.zeros(len(y))
    for reach in _REACHES:
        still = np.flatnonzero(~there)
        top, bottom = np.maximum(y[still] - reach, 0), np.minimum(y[still] + reach + 1, height)
        left, right = np.maximum(x[still] - reach, 0), np.minimum(x[still] + reach + 1, width)
        corners[:, still] = top, bottom, left, right
        count[still] = _window_sums(table, corners[:, still])
        there = count > 0.5
    return there, corners[:, there], count[there]


def _table(values: npt.NDArray[np.generic]) -> npt.NDArray[np.float64]:
    """Sums of all values (H, W) above and left of every corner, (H+1, W+1)."""
    return np.pad(values.cumsum(0, dtype=np.float64).cumsum(1), ((1, 0), (1, 0)))


def _window_sums(table: npt.NDArray[np.float64], corners: npt.NDArray[np.intp]) -> npt.NDArray[np.float64]:
    """Sums of a table over windows, from their top, bottom, left and right."""
    top, bottom, left, right = corners
    return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]


def focused_surfaces(
    known: KnownSurfaces | None, values: Array, lens: FocusedLens | None, factor: int = 1
) -> KnownSurfaces | None:
    """The same surfaces with their blur radii, pixels.

    Args:
        known: Surfaces in the unit of the map.
        values: The map, (H, W).
        lens: Lens and focus; None where the map is of blur radii.
        factor: By which such radii are multiplied.

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
    """The same layers with their blur radii, for the rays.

    Args:
        layers: In the unit of the map.
        lens: Lens and focus.

    Examples:
        >>> focused_layers(None, None) is None
        True
    """
    if layers is None or lens is None:
        return None
    radii = [lens.defocus(layers.values[:, :, layer]) for layer in range(layers.values.shape[2])]
    defocus = np.minimum.accumulate(np.stack(radii, 2), axis=2)
    return Layers(colors=layers.colors, defocus=defocus, coverage=layers.coverage)
