"""Pixels without data in stored maps: sentinel values of depth cameras, stereo and data sets."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.row_blocks import cut_row_blocks
from bokehnet.errors import ImageFileError

__all__ = ["Holes", "MissingData", "filled_map", "find_missing_depth", "find_missing_disparity"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
Holes = Literal["fill", "error"]

# Negative numbers that mark missing disparity in data sets, if the map has no other negative number; -1 only
# among numbers that are no normalised values.
_NEGATIVE_SENTINELS = (-1.0, -10.0, -99.0, -100.0, -999.0, -1000.0, -9999.0, -10000.0, -32768.0, -99999.0)
_MIN_UNNORMALISED = 2.0

_LARGEST_OF_8_BITS = 255

# Sentinel values are separated from the data by at least this fraction of the largest value.
_MIN_GAP = 0.05

# The largest value of normalised integer maps is at least this fraction of the type's; maps below store
# physical numbers, among which 0 is no distance.
_MIN_NORMALISED = 0.9

# Sparse maps: at least this fraction of the pixels lacks data, and at least this fraction of the others has
# at most one neighbour with data.
_MIN_SPARSE, _MIN_ISOLATED = 0.5, 0.5

# Scattered holes: zeros with a neighbour that has data, as a fraction of all zeros.
_MIN_SCATTERED = 0.5

# The largest count of an inverted map of 16 bits may mark missing data if all others are below this fraction
# of it, as millimetres of a depth camera.
_MAX_BELOW_SENTINEL = 0.5

# Different values of a measured map, at least; drawn ones have fewer.
_MIN_MEASURED = 16

# Pixels of 0 below this fraction of a map are no reason for a warning.
_MIN_ZEROS = 1e-3

# Largest counts are sky if the area that they cover contains at least this fraction of the top row.
_MIN_SKY_ROW = 0.3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MissingData:
    """Pixels without data.

    Attributes:
        mask: True where there are no data, (H, W).
        counts: Number of pixels by kind, such as "0" or "NaN".
        notes: Doubts about values, one line each.

    Examples:
        >>> MissingData(mask=np.array([[True, False]]), counts={"0": 1}).counts
        {'0': 1}
    """

    mask: Mask
    counts: dict[str, int]
    notes: tuple[str, ...] = ()


def find_missing_depth(
    numbers: Array, largest_integer: int | None, *, is_disparity: bool, no_data: float | None
) -> MissingData:
    """Return the pixels without data of a metric map.

    NaN, negative numbers and 0 are no depth; infinite depth is sky. The largest count of an integer file
    (65535 for 16 bits) has no data if it is isolated from the other values, unless it covers the top of the
    picture, where it is sky. Of metric disparity, 0 is sky unless the map is sparse.

    Args:
        numbers: Stored numbers, (H, W).
        largest_integer: Largest integer of the file; None for floats.
        is_disparity: True for metric disparity, False for depth.
        no_data: Number of pixels without data; None applies only the rules above.

    Examples:
        >>> numbers = np.array([[0, 900, np.nan, np.inf]], np.float32)
        >>> find_missing_depth(numbers, None, is_disparity=False, no_data=None).mask.tolist()
        [[True, False, True, False]]
    """
    masks = {"NaN": np.isnan(numbers), "negative": numbers < 0}
    if is_disparity:
        masks["infinite"] = np.isposinf(numbers)
        zeros = numbers == 0
        if is_sparse(zeros):
            masks["0"] = zeros
    else:
        masks["0"] = numbers == 0
        top = largest_integer is not None and numbers == largest_integer
        if isinstance(top, np.ndarray) and top.any() and _is_isolated_top(numbers, top):
            masks[f"{largest_integer}"] = top
    return _collected(masks, numbers, no_data)


def find_missing_disparity(
    numbers: Array, largest_integer: int | None, *, invert: bool, no_data: float | None
) -> MissingData:
    """Return the pixels without data of a relative map.

    NaN and infinity are no data, and so is a usual sentinel such as -1 or -9999 below positive numbers. In a
    normalised map 0 is the farthest value, or the nearest if inverted. It has no data if the map is sparse;
    or if the map stores physical integers (its largest is far below that of the type), nothing is near 0, and
    the map is inverted or the zeros are scattered. The largest count of an inverted map of 16 bits has no
    data if the others are far below, and its pixels are scattered and no sky at the top of the picture.

    Args:
        numbers: Stored numbers, (H, W).
        largest_integer: Largest integer of the file; None for floats.
        invert: True if large numbers are far.
        no_data: Number of pixels without data; None applies only the rules above.

    Examples:
        >>> numbers = np.array([[-1, 20, 30, np.inf]], np.float32)
        >>> find_missing_disparity(numbers, None, invert=False, no_data=None).mask.tolist()
        [[True, False, False, True]]
    """
    masks: dict[str, Mask] = {}
    if not all(np.isfinite(numbers[rows]).all() for rows in cut_row_blocks(numbers.shape)):
        masks = {"NaN": np.isnan(numbers), "infinite": np.isinf(numbers)}
    notes: tuple[str, ...] = ()
    low = min((float(block.min()) for block in _finite_blocks(numbers)), default=None)
    if low is not None:
        high = max(float(block.max()) for block in _finite_blocks(numbers))
        above = (block[block > low] for block in _finite_blocks(numbers))
        following = min((float(block.min()) for block in above if block.size), default=low)
        is_gap = following - low >= _MIN_GAP * (high - min(low, 0.0)) > 0
        if low in _NEGATIVE_SENTINELS and following >= 0 and high > _MIN_UNNORMALISED:
            masks[f"{low:g}"] = numbers == low
        elif low == 0 and is_gap and no_data != 0:
            zeros = numbers == 0
            physical = largest_integer is not None and high < _MIN_NORMALISED * largest_integer
            if is_sparse(zeros) or (physical and (invert or _is_scattered(zeros))):
                masks["0"] = zeros
            elif invert and zeros.mean() >= _MIN_ZEROS:
                notes = (
                    f"{int(zeros.sum())} pixels of the map are 0 and count as nearest; `depth.no_data` 0 "
                    "marks them as pixels without data",
                )
        if invert and no_data is None and high == largest_integer != _LARGEST_OF_8_BITS:
            top, doubts = _largest_as_missing(numbers, high)
            masks[f"{high:.0f}"], notes = top, notes + doubts
    missing = _collected(masks, numbers, no_data, notes)
    return replace(missing, counts={"NaN": 0, "infinite": 0} | missing.counts)


def is_sparse(missing: Mask) -> bool:
    """Return whether the pixels that are not missing are few and isolated.

    Examples:
        >>> y, x = np.mgrid[:24, :24]
        >>> is_sparse((y % 4 > 0) | (x % 3 > 0)), is_sparse(x > 4)
        (True, False)
    """
    known = ~missing
    if missing.mean() < _MIN_SPARSE or not known.any():
        return False
    return float((_neighbours(known)[known] <= 1).mean()) >= _MIN_ISOLATED


def filled_map(
    values: Array, missing: MissingData, image: Array | None, holes: Holes, name: str
) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """Return a disparity map without NaN, with words for the summary and notes.

    Args:
        values: Disparity, (H, W), NaN where there are no data.
        missing: Pixels without data.
        image: Scene-linear picture of the same view.
        holes: Treatment of pixels without data.
        name: Name of the map in messages.

    Raises:
        ImageFileError: No pixel has data, or some have none and ``holes`` is "error".

    Examples:
        >>> values = np.array([[0.5, np.nan]], np.float32)
        >>> missing = MissingData(mask=np.isnan(values), counts={"0": 1})
        >>> filled, words, _ = filled_map(values, missing, None, "fill", "map.png")
        >>> filled.tolist(), words
        ([[0.5, 0.5]], ('50 % of the map without data filled',))
    """
    holey = np.isnan(values)
    count = int(holey.sum())
    if not count:
        return values, (), missing.notes
    percent = 100 * count / values.size
    share = f"{percent:.2g} %" if percent < 99.5 else f"{percent:.5g} %"
    kinds = ", ".join(f"{number} {kind}" for kind, number in missing.counts.items() if number)
    row, column = (int(index) for index in np.argwhere(holey)[0])
    fact = f"{name}: no data at {count} pixels ({share}: {kinds}), first at x={column}, y={row}"
    if count == values.size:
        raise ImageFileError(f"{fact}; the map is empty")
    if holes == "error":
        raise ImageFileError(
            f"{fact}; `depth.holes` fill fills them from the surfaces around; sky is infinite depth"
        )
    from bokehnet.scene.depth.hole_filling import fill_holes  # imports numba, 0.2 s

    filled = fill_holes(values, image)
    note = f"{fact}; filled along the surfaces of the picture, which `depth.holes` error refuses"
    return filled, (f"{share} of the map without data filled",), (note, *missing.notes)


def _collected(
    masks: dict[str, Mask], numbers: Array, no_data: float | None, notes: tuple[str, ...] = ()
) -> MissingData:
    if no_data is not None:
        masks[f"{no_data:g}"] = np.isclose(numbers, no_data, rtol=1e-6, atol=0)
    mask = np.zeros(numbers.shape, np.bool_)
    for one in masks.values():
        mask |= one
    counts = {kind: int(one.sum()) for kind, one in masks.items()}
    return MissingData(mask=mask, counts=counts, notes=notes)


def _finite_blocks(numbers: Array) -> Iterator[Array]:
    """Yield the finite numbers of one block of rows after another, (N,), where there are any."""
    for rows in cut_row_blocks(numbers.shape):
        block = numbers[rows]
        finite = block[np.isfinite(block)]
        if finite.size:
            yield finite


def _is_isolated_top(numbers: Array, top: Mask) -> bool:
    """Return whether the largest count is separated from the data, and no sky at the top of the picture."""
    others = numbers[~top]
    if others.size and others.max() > (1 - _MIN_GAP) * numbers[top][0]:
        return False
    return float(top[0].mean()) < _MIN_SKY_ROW


def _largest_as_missing(numbers: Array, high: float) -> tuple[Mask, tuple[str, ...]]:
    """Return the pixels of the largest count if they have no data; else none, and a note on doubts."""
    top = numbers == high
    none, below = np.zeros_like(top), numbers[numbers < high]
    if not _is_isolated_top(numbers, top) or len(np.unique(below)) < _MIN_MEASURED:
        return none, ()
    is_far_below, is_scattered = below.max() < _MAX_BELOW_SENTINEL * high, _is_scattered(top)
    if is_far_below and is_scattered:
        return top, ()
    if not (is_far_below or is_scattered) or top.mean() < _MIN_ZEROS:
        return none, ()
    return none, (
        f"{int(top.sum())} pixels of the map are {high:.0f} and count as farthest, all others are at most "
        f"{below.max():.0f}; `depth.no_data` {high:.0f} marks them as pixels without data",
    )


def _is_scattered(missing: Mask) -> bool:
    """Return whether most missing pixels have a neighbour with data."""
    return bool(missing.any()) and float((_neighbours(~missing)[missing] >= 1).mean()) >= _MIN_SCATTERED


def _neighbours(mask: Mask) -> npt.NDArray[np.uint8]:
    """Return the number of the four neighbours of each pixel that are in a mask, (H, W)."""
    count = np.zeros(mask.shape, np.uint8)
    count[1:] += mask[:-1]
    count[:-1] += mask[1:]
    count[:, 1:] += mask[:, :-1]
    count[:, :-1] += mask[:, 1:]
    return count
