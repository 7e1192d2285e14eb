"""Candidates of the subject: connected surfaces of bands of disparity, and their scores."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.square_windows import dilated, eroded, reduce_windows
from bokehnet.scene.subject.masks import label
from bokehnet.scene.subject.view import View

__all__ = ["certainty_of", "fallback", "filled_fraction", "score", "surfaces_of_bands"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


def surfaces_of_bands(view: View) -> list[Mask]:
    """Return the connected surfaces of all bands of disparity, ground excluded."""
    search = view.search
    free = view.values[~view.ground]
    if free.size == 0:
        return []
    ends = np.linspace(-0.01, 1.01, search.bands + 1)
    ends[0], ends[-1] = -np.inf, np.inf
    masks = []
    smallest = search.min_area * view.values.size
    for first in range(search.bands):
        for last in range(first + 1, search.bands + 1):
            if first == 0 and last == search.bands:
                continue
            band = (view.values > ends[first]) & (view.values <= ends[last]) & ~view.ground
            if band.sum() < smallest:
                continue
            labels = label(band)
            areas = np.bincount(labels.ravel())
            for number in np.flatnonzero(areas >= smallest):
                if number > 0:
                    masks.append(labels == number)
    return masks


def score(view: View, mask: Mask, boxes: Sequence[tuple[slice, slice]]) -> float:
    """Return the score of a candidate, about 0 to 1."""
    search = view.search
    area = mask.mean()
    size = min(1.0, area / search.full_area) ** 0.5
    size *= float(np.clip((0.8 - area) / (0.8 - search.large_area), 0, 1))
    if size == 0:
        return 0.0
    place = float(view.prior[mask].mean())
    outline = _outline(view, mask)
    near = 0.35 + 0.65 * float(np.median(view.rank[mask]))
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    box = (rows[-1] - rows[0] + 1) * (columns[-1] - columns[0] + 1)
    fill = float(mask.sum() / box) ** 0.3
    sides = mask[:, 0].sum() + mask[:, -1].sum() + mask[0].sum()
    border = float(np.exp(-2.0 * sides / np.sqrt(mask.sum())))
    if mask[:, 0].any() and mask[:, -1].any():  # a strip across the picture: horizon, wall, hedge
        border *= 0.4
    outside = ~mask & ~view.ground
    around = outside & dilated(mask, 6)
    detail = 1.0
    if outside.any():
        ratio = (view.detail[mask].mean() + 1e-3) / (view.detail[outside].mean() + 1e-3)
        detail = float(np.clip(ratio**0.25, 0.75, 1.25))
    color = 1.0
    if around.any():
        contrast = np.linalg.norm(view.colors[mask].mean(0) - view.colors[around].mean(0))
        color = 0.8 + 0.2 * min(1.0, float(contrast) / 0.15)
    face = 1.0
    for where in boxes:
        held = mask[where].mean() if mask[where].size else 0.0
        face = max(face, 1.0 + float(held))
    return size * place * outline * near * fill * border * detail * color * face


def _outline(view: View, mask: Mask) -> float:
    """Return the share of a candidate's outline that is a depth edge; an edge of an occluder counts half."""
    values, step = view.values, view.search.edge_step
    inner = eroded(mask, 1)
    rim = mask & ~inner
    inside = np.where(mask, values, -np.inf)
    inside = reduce_windows(inside, 2, np.maximum)
    rim[0], rim[:, 0], rim[:, -1] = False, False, False
    rim[-1] = False
    if not rim.any():
        return 0.0
    ahead = view.far[rim] < values[rim] - step
    behind = (view.near[rim] > inside[rim] + step) & ~ahead
    return float((ahead + 0.4 * behind).mean())


def filled_fraction(view: View, mask: Mask) -> float:
    """Return the fraction of a candidate in its outline if it is the rim of something nearer, else 1."""
    outside = label(~mask)
    edges = np.concatenate([outside[0], outside[-1], outside[:, 0], outside[:, -1]])
    holes = (outside > 0) & ~np.isin(outside, np.unique(edges))
    if not holes.any() or np.median(view.values[holes]) <= np.median(view.values[mask]):
        return 1.0
    return float(mask.sum() / (mask.sum() + holes.sum()))


def certainty_of(score: float) -> float:
    """Return the certainty of a score: a logistic curve."""
    return float(1 / (1 + np.exp(-(score - 0.22) / 0.07)))


def fallback(view: View) -> Mask:
    """Return the surface at the 70th percentile of disparity, weighted by the centre, ground last."""
    weight = view.prior**2 * np.where(view.ground, 0.2, 1.0)
    order = np.argsort(view.values, None)
    heaped = np.cumsum(weight.ravel()[order])
    middle = view.values.ravel()[order][np.searchsorted(heaped, 0.7 * heaped[-1])]
    close = np.abs(view.values - middle) <= view.search.surface_step
    labels = label(close)
    heaviest = np.argmax(np.bincount(labels.ravel(), (weight * close).ravel())[1:]) + 1
    return np.asarray(labels == heaviest)
