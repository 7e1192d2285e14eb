"""Subject of a picture: the surface to focus on, from depth, sharpness, colour and faces.

The map is cut into bands of disparity; the connected surfaces of each band are candidates. A candidate scores
by its place (near the centre or the thirds), size, nearness, outline (it stands in front of what is around
it), sharpness and colour contrast. Ground that runs out of the lower border is no candidate. A score that is
too low gives no subject; the focus then falls back to the centre-weighted near part of the picture.

The subject has a range of disparities, not one: estimated maps let the sides of a round body recede, and a
single plane would blur its outline.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample
from bokehnet.checks import check_map
from bokehnet.io.window import Window

__all__ = ["FaceDetector", "Subject", "SubjectSearch", "detect_faces", "find_subject", "surface_around"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

# Number of the best candidates that are checked for holes.
_MAX_FILLED = 12

# Maximum area of a grown surface, in areas of its candidate.
_MAX_GROWTH = 2.5

# Detector of faces: picture for display (H, W, 3) in [0, 1] to boxes (x, y, width, height) in pixels.
FaceDetector = Callable[[Array], Sequence[tuple[int, int, int, int]]]


@dataclass(frozen=True, kw_only=True, slots=True)
class SubjectSearch:
    """Tuned numbers of the search, measured by ``python -m benchmarks.quality.subject``.

    Disparities are relative to the range of the map between its 1st and 99th percentile.

    Attributes:
        side: Longer side of the picture that is analysed, pixels.
        bands: Number of bands of disparity of the finest division; candidates are unions of neighbours.
        min_area: Minimum area of a candidate, relative to the picture.
        full_area: Area from which on a candidate gets no penalty for being small.
        large_area: Area above which a candidate counts as background.
        edge_step: Difference of disparity that counts as a depth edge.
        surface_step: Maximum difference of disparity between neighbouring pixels of one surface.
        max_range: Maximum extent of the sharp range on either side of the subject's median disparity.
        ground_tolerance: Maximum deviation of ground from a plane.
        min_certainty: Certainty below which the fallback replaces the subject.

    Examples:
        >>> ramp = np.tile(np.linspace(0, 1, 60, dtype=np.float32), (40, 1))
        >>> image = np.full((40, 60, 3), 0.5, np.float32)
        >>> find_subject(image, ramp, search=SubjectSearch(min_certainty=1)).is_fallback
        True
    """

    side: int = 144
    bands: int = 10
    min_area: float = 0.006
    full_area: float = 0.06
    large_area: float = 0.5
    edge_step: float = 0.05
    surface_step: float = 0.02
    max_range: float = 0.12
    ground_tolerance: float = 0.03
    min_certainty: float = 0.35


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Subject:
    """Subject of a picture.

    Attributes:
        position: Pixel on the subject near its middle, (column, row) in the map.
        mask: Visible surface of the subject, (H, W), at the size of the analysis (coarse).
        disparity: Median disparity of the surface, in the unit of the map: the focus.
        near: Largest disparity that is to be sharp.
        far: Smallest disparity that is to be sharp.
        certainty: Certainty of the choice, 0 to 1.
        is_fallback: True if no candidate was certain, and the focus is the centre-weighted near part.

    Examples:
        >>> disparity = np.full((60, 90), 0.2, np.float32)
        >>> disparity[15:45, 30:55] = 0.8  # a card in front of a wall
        >>> card = find_subject(np.full((60, 90, 3), 0.5, np.float32), disparity)
        >>> card.note(Window.whole(90, 60))
        'focus on the subject at pixel 42,29 (`focus.at` changes it)'
    """

    position: tuple[int, int]
    mask: Mask
    disparity: float
    near: float
    far: float
    certainty: float
    is_fallback: bool

    def note(self, window: Window, supersampled: int = 1) -> str:
        """Return the choice of the focus as one line for a user.

        Args:
            window: Position of the map's pixels in the shown picture.
            supersampled: Size of the map relative to the result.
        """
        x, y = (
            (pixel + first) // supersampled
            for pixel, first in zip(self.position, (window.x, window.y), strict=True)
        )
        middle = "the nearer part of the middle, as no subject stands out,"
        goal = middle if self.is_fallback else "the subject"
        return f"focus on {goal} at pixel {x},{y} (`focus.at` changes it)"


def find_subject(
    image: Array,
    disparity: Array,
    *,
    faces: FaceDetector | None = None,
    search: SubjectSearch | None = None,
) -> Subject:
    """Return the subject of a picture.

    Args:
        image: Picture, scene-linear, (H, W, 3).
        disparity: Disparity of any unit, near is large, (h, w); another size than the picture's is allowed.
        faces: Detector of faces, such as :func:`detect_faces`; None for no faces.
        search: Tuned numbers.

    Raises:
        ShapeError, ParameterError: The map has a wrong shape, NaN or infinity.

    Examples:
        >>> disparity = np.full((60, 90), 0.2, np.float32)
        >>> disparity[15:45, 30:55] = 0.8  # a card in front of a wall
        >>> subject = find_subject(np.full((60, 90, 3), 0.5, np.float32), disparity)
        >>> subject.is_fallback, round(subject.disparity, 2), subject.position
        (False, 0.8, (42, 29))
    """
    check_map("disparity", disparity)
    search = search or SubjectSearch()
    view = _View(image, np.asarray(disparity, np.float32), search)
    boxes = () if faces is None else view.scaled_boxes(faces(_display(image)), image.shape[:2])
    candidates = _candidates(view)
    scores = [_score(view, mask, boxes) for mask in candidates]
    for index in np.argsort(scores)[::-1][:_MAX_FILLED]:
        scores[index] *= _filled_fraction(view, candidates[index])
    best = int(np.argmax(scores)) if scores else -1
    certainty = _certainty(scores[best]) if scores else 0.0
    if certainty < search.min_certainty:
        return view.subject(_fallback(view), certainty, is_fallback=True)
    return view.subject(candidates[best], certainty, is_fallback=False)


def surface_around(disparity: Array, pixel: tuple[int, int], search: SubjectSearch | None = None) -> Subject:
    """Return the surface at a pixel, with the range of disparities of its connected part.

    Args:
        disparity: Disparity of any unit, near is large, (H, W).
        pixel: Column and row.
        search: Tuned numbers.

    Raises:
        ShapeError, ParameterError: The map has a wrong shape, NaN or infinity.

    Examples:
        >>> disparity = np.full((60, 90), 0.2, np.float32)
        >>> disparity[15:45, 30:55] = np.linspace(0.75, 0.8, 25)  # a card that is turned a little
        >>> card = surface_around(disparity, (40, 30))
        >>> round(card.far, 2), round(card.near, 2)
        (0.75, 0.8)
    """
    check_map("disparity", disparity)
    search = search or SubjectSearch()
    values = np.asarray(disparity, np.float32)
    view = _View(np.zeros((*values.shape, 3), np.float32), values, search)
    row = min(int(pixel[1] * view.height / values.shape[0]), view.height - 1)
    column = min(int(pixel[0] * view.width / values.shape[1]), view.width - 1)
    seed = np.zeros((view.height, view.width), bool)
    seed[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = True
    middle = view.values[row, column]
    seed &= np.abs(view.values - middle) <= search.surface_step
    return view.subject(_grown(view, seed), 1.0, is_fallback=False)


def detect_faces(picture: Array) -> list[tuple[int, int, int, int]]:
    """Return boxes around upright frontal faces by local binary patterns; needs scikit-image.

    Args:
        picture: Picture for display, (H, W, 3), values in [0, 1].

    Returns:
        Boxes (x, y, width, height) in pixels; empty without faces or without scikit-image.

    Examples:
        >>> detect_faces(np.full((100, 150, 3), 0.5, np.float32))
        []

    References:
        Ahonen, Hadid, Pietikainen, "Face description with local binary patterns", 2006; Viola and Jones,
        "Rapid object detection using a boosted cascade of simple features", 2001.
    """
    try:
        from skimage.data import lbp_frontal_face_cascade_filename
        from skimage.feature import Cascade
    except ImportError:
        return []
    shrink = max(1.0, max(picture.shape[:2]) / 480)
    height, width = (max(round(side / shrink), 1) for side in picture.shape[:2])
    small = picture if shrink == 1 else resample(picture, height, width, "area")
    least = max(round(0.06 * max(height, width)), 24)
    if min(height, width) <= least:
        return []
    boxes = Cascade(lbp_frontal_face_cascade_filename()).detect_multi_scale(
        img=(255 * small).astype(np.uint8),
        scale_factor=1.2,
        step_ratio=1,
        min_size=(least, least),
        max_size=(min(height, width), min(height, width)),
        min_neighbor_number=6,
    )
    return [
        (
            round(box["c"] * shrink),
            round(box["r"] * shrink),
            round(box["width"] * shrink),
            round(box["height"] * shrink),
        )
        for box in boxes
    ]


class _View:
    """Coarse copy of picture and map, with the cues that do not depend on a candidate.

    Attributes:
        values: Disparity relative to the range of the map, about 0 to 1, (height, width).
        ground: Pixels on the ground.
        colors: Lightness and two opponent colours, (height, width, 3).
        detail: Mean gradient of the full picture in each coarse pixel.
        prior: Preference for the centre and the thirds, 0 to 1.
        rank: Share of the picture that is farther than each pixel.
    """

    def __init__(self, image: Array, disparity: Array, search: SubjectSearch) -> None:
        self.search, self.full = search, disparity
        shrink = max(1.0, max(disparity.shape) / search.side)
        self.height, self.width = (max(round(side / shrink), 1) for side in disparity.shape)
        rows = ((np.arange(self.height) + 0.5) * disparity.shape[0] / self.height).astype(int)
        columns = ((np.arange(self.width) + 0.5) * disparity.shape[1] / self.width).astype(int)
        self.raw = disparity[rows][:, columns]
        low, high = np.percentile(self.raw, (1, 99))
        self.span = float(max(high - low, 1e-12))
        self.values: Array = _median3((self.raw - np.float32(low)) / np.float32(self.span))
        shown = _display(resample(np.asarray(image, np.float32), self.height, self.width, "area"))
        red, green, blue = np.moveaxis(shown, -1, 0)
        self.colors = np.stack([(red + green + blue) / 3, red - green, (red + green) / 2 - blue], -1)
        self.detail = _detail(image, self.height, self.width)
        y, x = np.mgrid[0.5 : self.height, 0.5 : self.width]
        x, y = x / self.width, y / self.height
        self.prior = np.exp(-(((x - 0.5) / 0.24) ** 2) / 2 - ((y - 0.52) / 0.3) ** 2 / 2)
        for third in (1 / 3, 2 / 3):
            beside = np.exp(-(((x - third) / 0.13) ** 2) / 2 - ((y - 0.55) / 0.3) ** 2 / 2)
            self.prior = np.maximum(self.prior, 0.9 * beside)
        self.rank = np.searchsorted(np.sort(self.values, None), self.values) / self.values.size
        self.ground = _ground(self.values, search)

    def scaled_boxes(
        self, boxes: Sequence[tuple[int, int, int, int]], size: tuple[int, ...]
    ) -> list[tuple[slice, slice]]:
        """Return boxes of the full picture as rows and columns of the coarse one."""
        down, across = self.height / size[0], self.width / size[1]
        return [
            (
                slice(round(y * down), max(round((y + height) * down), round(y * down) + 1)),
                slice(round(x * across), max(round((x + width) * across), round(x * across) + 1)),
            )
            for x, y, width, height in boxes
        ]

    def subject(self, mask: Mask, certainty: float, *, is_fallback: bool) -> Subject:
        """Return the subject of a mask, grown to its connected surface unless that joins its surroundings."""
        surface = _grown(self, mask)
        if surface.sum() > _MAX_GROWTH * mask.sum():  # into the surroundings
            surface = mask
        values = self.raw[surface]
        limit = self.search.max_range * self.span
        median = float(np.median(self.raw[mask]))
        far, near = (float(end) for end in np.percentile(values, (2, 98)))
        row, column = _middle_pixel(mask, np.abs(self.raw - median))
        height, width = self.full.shape
        position = int((column + 0.5) * width / self.width), int((row + 0.5) * height / self.height)
        return Subject(
            position=position,
            mask=surface,
            disparity=median,
            near=max(min(near, median + limit), median),
            far=min(max(far, median - limit), median),
            certainty=certainty,
            is_fallback=is_fallback,
        )


def _display(image: Array) -> Array:
    """Return a picture for display in [0, 1] whose 99th percentile is at most white."""
    light = np.maximum(np.asarray(image, np.float32)[..., :3], 0)
    white = max(float(np.percentile(light[::4, ::4], 99)) if light.size else 1.0, 1.0)
    shown: Array = np.minimum(light / np.float32(white), 1) ** np.float32(1 / 2.2)
    return shown


def _detail(image: Array, height: int, width: int) -> Array:
    """Return the mean absolute gradient of the square root of green in each coarse pixel."""
    green = np.sqrt(np.clip(np.asarray(image[..., 1], np.float32), 0, 1))
    steps = np.zeros_like(green)
    steps[:, 1:] = np.abs(np.diff(green, axis=1))
    steps[1:] += np.abs(np.diff(green, axis=0))
    return resample(steps, height, width, "area")


def _median3(values: Array) -> Array:
    """Return the median of 3x3 pixels, borders repeated."""
    padded = np.pad(values, 1, mode="edge")
    height, width = values.shape
    shifted = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(np.median(shifted, axis=0), np.float32)


def _ground(values: Array, search: SubjectSearch) -> Mask:
    """Return the pixels of a plane that runs out of the lower border; none where there is no such plane.

    Disparity of a plane is affine in pixels (perspective projection). The plane is found by random samples of
    three pixels (Fischler and Bolles, "Random sample consensus", 1981), with a fixed seed.
    """
    height, width = values.shape
    y, x = np.mgrid[0:height, 0:width]
    xs, ys = x / width - 0.5, y / height
    lower = y >= height // 2
    rng = np.random.default_rng(0)
    pool = np.flatnonzero(lower.ravel())
    flat, fx, fy = values.ravel(), xs.ravel(), ys.ravel()
    thinned = pool[:: max(1, pool.size // 2000)]
    best, plane = 0.0, None
    for _ in range(200):
        picks = rng.choice(pool, 3, replace=False)
        system = np.stack([fx[picks], fy[picks], np.ones(3)], 1)
        if abs(np.linalg.det(system)) < 1e-3:
            continue
        across, down, start = np.linalg.solve(system, flat[picks])
        if down < 0.15 or abs(across) > 0.5 * down:
            continue
        error = np.abs(flat[thinned] - across * fx[thinned] - down * fy[thinned] - start)
        share = float(np.mean(error < search.ground_tolerance))
        if share > best:
            best, plane = share, (across, down, start)
    nothing = np.zeros(values.shape, bool)
    if plane is None or best < 0.2:
        return nothing
    near_plane = np.abs(values - plane[0] * xs - plane[1] * ys - plane[2]) < search.ground_tolerance
    if near_plane[-max(height // 20, 1) :].mean() < 0.3:
        return nothing
    labels = _label(near_plane)
    borders = np.unique(labels[-1][labels[-1] > 0])
    ground: Mask = np.isin(labels, borders) & near_plane
    return ground


def _candidates(view: _View) -> list[Mask]:
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
            labels = _label(band)
            areas = np.bincount(labels.ravel())
            for number in np.flatnonzero(areas >= smallest):
                if number > 0:
                    masks.append(labels == number)
    return masks


def _score(view: _View, mask: Mask, boxes: Sequence[tuple[slice, slice]]) -> float:
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
    around = outside & _dilated(mask, 6)
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


def _outline(view: _View, mask: Mask) -> float:
    """Return the share of a candidate's outline that is a depth edge; an edge of an occluder counts half."""
    values, step = view.values, view.search.edge_step
    inner = _eroded(mask, 1)
    rim = mask & ~inner
    far = _filtered(values, 3, np.minimum)
    near = _filtered(values, 3, np.maximum)
    inside = np.where(mask, values, -np.inf)
    inside = _filtered(inside, 2, np.maximum)
    rim[0], rim[:, 0], rim[:, -1] = False, False, False
    rim[-1] = False
    if not rim.any():
        return 0.0
    ahead = far[rim] < values[rim] - step
    behind = (near[rim] > inside[rim] + step) & ~ahead
    return float((ahead + 0.4 * behind).mean())


def _filled_fraction(view: _View, mask: Mask) -> float:
    """Return the fraction of a candidate in its outline if it is the rim of something nearer, else 1."""
    outside = _label(~mask)
    edges = np.concatenate([outside[0], outside[-1], outside[:, 0], outside[:, -1]])
    holes = (outside > 0) & ~np.isin(outside, np.unique(edges))
    if not holes.any() or np.median(view.values[holes]) <= np.median(view.values[mask]):
        return 1.0
    return float(mask.sum() / (mask.sum() + holes.sum()))


def _certainty(score: float) -> float:
    """Return the certainty of a score: a logistic curve."""
    return float(1 / (1 + np.exp(-(score - 0.22) / 0.07)))


def _fallback(view: _View) -> Mask:
    """Return the surface at the 70th percentile of disparity, weighted by the centre, ground last."""
    weight = view.prior**2 * np.where(view.ground, 0.2, 1.0)
    order = np.argsort(view.values, None)
    heaped = np.cumsum(weight.ravel()[order])
    middle = view.values.ravel()[order][np.searchsorted(heaped, 0.7 * heaped[-1])]
    close = np.abs(view.values - middle) <= view.search.surface_step
    labels = _label(close)
    heaviest = np.argmax(np.bincount(labels.ravel(), (weight * close).ravel())[1:]) + 1
    return np.asarray(labels == heaviest)


def _grown(view: _View, mask: Mask) -> Mask:
    """Return the mask with the smoothly connected rest of its surface, without ground."""
    middle = float(np.median(view.values[mask]))
    allowed = (np.abs(view.values - middle) <= view.search.max_range) & ~view.ground
    allowed |= mask
    grown = mask.copy()
    step = view.search.surface_step
    for _ in range(max(view.height, view.width)):
        before = grown.sum()
        for axis in (0, 1):
            for towards in (1, -1):
                moved, values = np.roll(grown, towards, axis), np.roll(view.values, towards, axis)
                edge = [slice(None), slice(None)]
                edge[axis] = slice(0, 1) if towards == 1 else slice(-1, None)
                moved[tuple(edge)] = False
                grown |= moved & allowed & (np.abs(view.values - values) <= step)
        if grown.sum() == before:
            break
    return grown


def _middle_pixel(mask: Mask, difference: Array) -> tuple[int, int]:
    """Return the pixel of a mask that is close to its centroid, inside, and of about its median disparity."""
    inner = mask
    for radius in (4, 2, 1):
        eroded = _eroded(mask, radius)
        if eroded.any():
            inner = eroded
            break
    typical = inner & (difference <= np.median(difference[inner]))
    rows, columns = np.nonzero(typical)
    all_rows, all_columns = np.nonzero(mask)
    distance = (rows - all_rows.mean()) ** 2 + (columns - all_columns.mean()) ** 2
    nearest = int(np.argmin(distance))
    return int(rows[nearest]), int(columns[nearest])


def _filtered(values: Array, radius: int, choose: Callable[[Array, Array], Array]) -> Array:
    """Return the minimum or maximum over a square, borders repeated."""
    for axis in (0, 1):
        padded = np.pad(values, [(radius, radius) if axis == one else (0, 0) for one in (0, 1)], mode="edge")
        length = values.shape[axis]
        result = np.take(padded, range(length), axis)
        for shift in range(1, 2 * radius + 1):
            result = choose(result, np.take(padded, range(shift, shift + length), axis))
        values = result
    return values


def _eroded(mask: Mask, radius: int) -> Mask:
    return _filtered(mask.astype(np.float32), radius, np.minimum) > 0


def _dilated(mask: Mask, radius: int) -> Mask:
    return _filtered(mask.astype(np.float32), radius, np.maximum) > 0


def _label(mask: Mask) -> npt.NDArray[np.intp]:
    """Return the number of the 4-connected component of each pixel, from 1; 0 outside the mask."""
    height, width = mask.shape
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, starts = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
    parents = list(range(rows.size))

    def root(run: int) -> int:
        while parents[run] != run:
            parents[run] = parents[parents[run]]
            run = parents[run]
        return run

    first = np.searchsorted(rows, np.arange(height + 1)).tolist()
    begin, end = starts.tolist(), ends.tolist()
    for row in range(1, height):
        above, below = first[row - 1], first[row]
        while above < first[row] and below < first[row + 1]:
            if begin[above] < end[below] and begin[below] < end[above]:
                parents[root(below)] = root(above)
            if end[above] < end[below]:
                above += 1
            else:
                below += 1
    roots = np.array([root(run) for run in range(rows.size)], np.intp)
    numbers = np.unique(roots, return_inverse=True)[1] + 1
    labels = np.zeros(height * width + 1, np.intp)
    np.add.at(labels, rows * width + starts, numbers)
    np.add.at(labels, rows * width + ends, -numbers)
    return np.cumsum(labels[:-1]).reshape(height, width)
