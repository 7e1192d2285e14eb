"""Hybrid of post-process and rays: traces rays into the scene where the post-process can be wrong.

A mask limits the number of rays of a pixel, and the variance of its rays so far determines the actual number.
A ray passes from a point of the pupil through the pixel's point in focus, after Cook. Hits in front of the
plane of focus form the near field, the others the far field; the fraction of near hits blends both. Noise is
smoothed where the variance is high, and the ray-traced light is blended with the post-process.

Faults as published: the mask misses edges between parallel surfaces, and all of a wide blur except its
    centre; pixels in focus stay sharp under a near blur; the smoothing ignores edges.

Source: Tan et al., "A hybrid system for real-time rendering of depth of field effect in games", 2022, after
    thesis 000, 5.0.2, 5.0.3 and 5.1.2. Half resolution and temporal anti-aliasing are omitted: everything is
    at full resolution. :mod:`bokehnet.baselines.rays.reprojection` transfers the sums of the last frame.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from bokehnet.baselines.gather.scatter_as_you_gather import tan
from bokehnet.baselines.rays.breda_compositing import (
    composite_breda,
    composite_fields,
    split_fields,
)
from bokehnet.baselines.rays.ray_mask import gaussian, in_mixed_tiles, ray_mask
from bokehnet.baselines.rays.reprojection import History
from bokehnet.checks import check_above, check_choice, check_same_size, check_whole
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.lenses.base import LensModel
from bokehnet.optics.pixels.sample_allocation import Allocation
from bokehnet.optics.sampling import disc_from_square

__all__ = [
    "RULES",
    "RaySelection",
    "SelectiveResult",
    "TraceRays",
    "checked_trace",
    "lens_rays",
    "selective_rays",
]

# Function of origins and directions (N, 3), mm; returns scene-linear colours (N, 3), depths (N,), mm, and the
# mask of hits (N,).
TraceRays = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]

RULES = ("tan", "ours", "breda", "fields")

# Weights of the variance for rays (5.10) and for smoothing, and the maximum smoothing (5.13).
_RAY_VARIANCE_WEIGHT, _SMOOTHING_VARIANCE_WEIGHT, _MAX_SMOOTHING = 1e5, 2e3, 0.9

# Fraction of near hits above which a far pixel uses the post-process.
_HIT_RATIO = 0.3

# Maximum radius of the smoothing, and maximum blur radius of a pixel in focus, pixels.
_MAX_SMOOTHING_RADIUS_PX, _IN_FOCUS_RADIUS_PX = 6, 0.5 * np.sqrt(2)

# Variance of the mean luminance below which a pixel needs no more rays; sigma of the window that averages
# errors, pixels; and minimum fraction of rays of a pixel whose post-process seems right.
_TARGET_VARIANCE, _ERROR_SIGMA_PX, _MIN_RAY_FRACTION = 2e-5, 2.0, 0.1

# Iterations that redistribute rays above a pixel's maximum.
_REDISTRIBUTION_ITERATIONS = 4

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, kw_only=True)
class SelectiveResult:
    """Result of the hybrid.

    Attributes:
        bokeh: Picture, scene-linear, (H, W, 3).
        post_process: Picture of the post-process, (H, W, 3).
        rays: Number of rays of each pixel, (H, W).
        hit_ratio: Fraction of rays that hit in front of the plane of focus, (H, W); 0 without rays.
        variance: Variance of one ray's luminance, (H, W).
        history: Sums over the rays, for the next frame of a moving scene.
    """

    bokeh: np.ndarray
    post_process: np.ndarray
    rays: np.ndarray
    hit_ratio: np.ndarray
    variance: np.ndarray
    history: History


def lens_rays(
    lens: LensModel, size: tuple[int, int], pixel_pitch: float, pixels: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions (N, 3), mm, of one random ray for each pixel (N,)."""
    height, width = size
    y, x = np.divmod(pixels, width)
    jitter = rng.random((len(pixels), 4))
    position = np.stack([x - 0.5 * width, y - 0.5 * height], -1) + jitter[:, :2]
    rays = lens.sample_rays(-pixel_pitch * position, disc_from_square(jitter[:, 2:]))
    zero, one = np.zeros((len(pixels), 1)), np.ones((len(pixels), 1))
    origin = np.broadcast_to(rays.origin, (len(pixels), 2))
    return np.concatenate([origin, zero], 1), np.concatenate([rays.slope, one], 1)


def checked_trace(
    trace_rays: TraceRays, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the checked result of a callback.

    Raises:
        ParameterError: The callback raised, returned anything but three arrays, NaN, or hits without depth.
        ShapeError: The arrays are not (N, 3), (N,) and (N,).
    """
    try:
        result = trace_rays(origins, directions)
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
        raise ParameterError("trace_rays", "colour, depth and hit of each ray", shown=problem) from error
    if not isinstance(result, tuple) or len(result) != 3:
        raise ParameterError(
            "trace_rays", "colour, depth and hit of each ray", shown=f"a {type(result).__name__}"
        )
    color, depth, hit = (np.asarray(part) for part in result)
    count = len(origins)
    for name, part, shape in (
        ("colour", color, (count, 3)),
        ("depth", depth, (count,)),
        ("hit", hit, (count,)),
    ):
        if part.shape != shape:
            raise ShapeError(f"trace_rays: expected {name} of shape {shape}, got {part.shape}")
    hit = hit.astype(bool)
    bad = int((~np.isfinite(color)).any(-1).sum() + (~(depth[hit] > 0)).sum())
    if bad:
        raise ParameterError(
            "trace_rays",
            "finite colours, and depths above 0 where it hits",
            shown=f"{bad} rays with others",
        )
    return color, np.where(hit, depth, np.inf), hit


class _Moments:
    """Sums over the rays of each pixel so far: near and far field, and two moments of the luminance."""

    def __init__(self, pixels: int) -> None:
        self.light = np.zeros((2, pixels, 3))  # near, far
        self.count = np.zeros((2, pixels))
        self.first, self.second = np.zeros(pixels), np.zeros(pixels)

    def start_from(self, history: History) -> None:
        """Start from the sums of another frame."""
        self.light, self.count = history.light.copy(), history.count.copy()
        self.first, self.second = history.first.copy(), history.second.copy()

    def add(self, pixels: np.ndarray, color: np.ndarray, near: np.ndarray) -> None:
        luminance = color @ _LUMINANCE
        for field, mask in ((0, near), (1, ~near)):
            pixels_of_field = pixels[mask]
            self.count[field] += np.bincount(pixels_of_field, minlength=len(self.first))
            for channel in range(3):
                self.light[field, :, channel] += np.bincount(
                    pixels_of_field, color[mask, channel], len(self.first)
                )
        self.first += np.bincount(pixels, luminance, len(self.first))
        self.second += np.bincount(pixels, luminance**2, len(self.first))

    @property
    def rays(self) -> np.ndarray:
        total: np.ndarray = self.count.sum(0)
        return total

    @property
    def variance(self) -> np.ndarray:
        """Variance of one ray's luminance (5.12)."""
        count = np.maximum(self.rays, 1)
        return np.maximum(self.second / count - (self.first / count) ** 2, 0)

    def merged(self) -> tuple[np.ndarray, np.ndarray]:
        """Return both fields blended by the hit ratio (5.5), and the ratio."""
        ratio = self.count[0] / np.maximum(self.rays, 1)
        near, far = (self.light[i] / np.maximum(self.count[i], 1)[:, None] for i in (0, 1))
        return far + (near - far) * ratio[:, None], ratio


@dataclass(frozen=True, kw_only=True)
class RaySelection:
    """Parameters of the hybrid: pixels that send rays, number of rays, and composition.

    Attributes:
        mask: Selection of the pixels that send rays: ``sobel``, ``sobel-depth`` or ``reach``, see
            :mod:`bokehnet.baselines.rays.ray_mask`; or the fraction of ``max_rays`` of each pixel, (H, W), 0
            to 1.
        rule: ``tan``: as published. ``ours``: sends rays where they are noisy and differ from the
            post-process, and blends both with the minimum expected error. ``breda`` and ``fields``: rays as
            published, composited as in :mod:`bokehnet.baselines.rays.breda_compositing`.
        by_tile: Send no rays in tiles of one depth (:func:`bokehnet.baselines.rays.ray_mask.in_mixed_tiles`),
            and select a strategy per tile in Tan's post-process.
        max_rays: Maximum number of rays per pixel and frame, at least 1.
        frames: Number of accumulated frames of a static scene, at least 1.
        budget: Maximum mean number of rays per pixel over all frames.
        post_process: Function that blurs a picture by its defocus in pixels; default: Tan's.
        specular: Pixels whose highlights use the post-process, as published, (H, W) bool.
        allocation: With ``ours``, from the second frame on: rule that distributes the rays of a frame by the
            noise visible in the blend (:mod:`bokehnet.optics.pixels.sample_allocation`). None: each pixel
            sends as many rays as make its noise invisible.
        history: History of the last frame, reprojected to this one
            (:mod:`bokehnet.baselines.rays.reprojection`).
        seed: Seed of the rays.

    Raises:
        ParameterError: A choice or number is invalid.

    Examples:
        >>> RaySelection(mask="reach", rule="ours").max_rays
        5
    """

    mask: str | np.ndarray = "sobel"
    rule: str = "tan"
    by_tile: bool = False
    max_rays: int = 5
    frames: int = 8
    budget: float | None = None
    post_process: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    specular: np.ndarray | None = None
    allocation: Allocation | None = None
    history: History | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("rule", self.rule, RULES)
        check_whole("max_rays", self.max_rays, 1)
        check_whole("frames", self.frames, 1)
        if self.budget is not None:
            check_above("budget", self.budget, 0)


def selective_rays(
    image: np.ndarray,
    depth: np.ndarray,
    normals: np.ndarray,
    trace_rays: TraceRays,
    lens: LensModel,
    pixel_pitch: float,
    selection: RaySelection | None = None,
) -> SelectiveResult:
    """Render by post-process, and by rays where it can be wrong.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        depth: Depth of the pixels along the axis, mm, (H, W), finite.
        normals: Unit normals, (H, W, 3).
        trace_rays: Function that traces rays into the scene.
        lens: Ideal, focused lens.
        pixel_pitch: Pixel pitch, mm.
        selection: Pixels that send rays, and what becomes of them; default: as published.

    Raises:
        ParameterError: The mask is invalid, or ``trace_rays`` fails.
        ShapeError: The sizes differ.
    """
    selection = selection or RaySelection()
    rule = selection.rule
    for name, array in (("depth", depth), ("normals", normals)):
        check_same_size("image", image, name, array)
    defocus = np.asarray(lens.coc_radius(1 / np.asarray(depth, np.float64)) / pixel_pitch, np.float32)
    size = defocus.shape
    blur = selection.post_process or partial(tan, by_tile=selection.by_tile)
    post = blur(np.asarray(image, np.float32), defocus)
    ray_fraction = ray_mask(selection.mask, normals, depth, defocus).ravel()
    if selection.by_tile:
        ray_fraction = ray_fraction * in_mixed_tiles(defocus).ravel()
    focus = float(1 / _disparity_in_focus(lens))
    moments, rng = _Moments(defocus.size), np.random.default_rng(selection.seed)
    if selection.history is not None:
        check_same_size("image", image, "history", selection.history.depth)
        moments.start_from(selection.history)
    sent_before = moments.rays
    for frame in range(selection.frames):
        counts = _ray_counts(selection, moments, ray_fraction, post, sent_before, frame, rng)
        pixels = np.repeat(np.arange(defocus.size), counts.astype(np.int64))
        if len(pixels):
            origins, directions = lens_rays(lens, size, pixel_pitch, pixels, rng)
            color, hit_depth, _ = checked_trace(trace_rays, origins, directions)
            moments.add(pixels, color, hit_depth < focus)
    merged, ratio = moments.merged()
    sent, variance = moments.rays, moments.variance
    flat = post.reshape(-1, 3)
    if rule in ("breda", "fields"):
        result = _by_fields(rule, image, depth, defocus, focus, post, blur, moments)
    else:
        if rule == "tan":
            radius = np.abs(defocus).ravel()
            light, ratio = _smoothed(merged, ratio, sent, variance, radius, size)
            ray_weight = _published_ray_weight(sent, ratio, defocus.ravel())
        else:
            light, ray_weight = merged, _expected_error(moments, flat, size)[1]
        if selection.specular is not None:
            check_same_size("image", image, "specular", selection.specular)
            ray_weight = np.where(np.ravel(selection.specular), 0.0, ray_weight)
        result = flat + ray_weight[:, None] * (light - flat)
        sharp = (np.abs(defocus).ravel() <= _IN_FOCUS_RADIUS_PX) & ((rule == "tan") | (sent == 0))
        result = np.where(sharp[:, None], np.reshape(image, (-1, 3)), result)
    return SelectiveResult(
        bokeh=result.reshape(*size, 3).astype(np.float32),
        post_process=post,
        rays=(sent - sent_before).reshape(size),
        hit_ratio=ratio.reshape(size),
        variance=variance.reshape(size),
        history=History(
            light=moments.light,
            count=moments.count,
            first=moments.first,
            second=moments.second,
            depth=np.asarray(depth, np.float64),
        ),
    )


def _ray_counts(
    selection: RaySelection,
    moments: _Moments,
    ray_fraction: np.ndarray,
    post: np.ndarray,
    sent_before: np.ndarray,
    frame: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the number of rays of each pixel in a frame, (H * W,)."""
    budget, frames, max_rays = selection.budget, selection.frames, selection.max_rays
    size, flat = post.shape[:2], post.reshape(-1, 3)
    fraction = _fraction_of_rays(moments, ray_fraction, flat, size, selection.rule, frame)
    counts: np.ndarray = np.round(fraction * max_rays)
    if selection.allocation is not None and selection.rule == "ours" and frame:
        limit = counts.sum()
        if budget is not None:  # unused rays of earlier frames carry over
            limit = (budget * (frame + 1) / frames) * len(flat) - (moments.rays - sent_before).sum()
        visible_variance = _visible_variance(moments, flat, size) * (ray_fraction > 0)
        return _capped(selection.allocation, visible_variance, moments.rays, int(limit), max_rays)
    if budget is not None and counts.mean() > budget / frames:
        counts = np.floor(fraction * max_rays * (budget / frames / counts.mean()) + rng.random(len(flat)))
    return counts


def _by_fields(
    rule: str,
    image: np.ndarray,
    depth: np.ndarray,
    defocus: np.ndarray,
    focus: float,
    post: np.ndarray,
    blur: Callable[[np.ndarray, np.ndarray], np.ndarray],
    moments: _Moments,
) -> np.ndarray:
    """Return the composite of ``breda`` or ``fields``, (H * W, 3)."""
    size = defocus.shape
    fields = split_fields(image, defocus, blur)
    if rule == "fields":
        near, far = (
            (moments.light[i] / np.maximum(moments.count[i], 1)[:, None]).reshape(*size, 3) for i in (0, 1)
        )
        return composite_fields(fields, near, far, moments.count.reshape(2, *size)).reshape(-1, 3)
    merged, ratio = moments.merged()
    radius = np.abs(defocus).ravel()
    light, ratio = _smoothed(merged, ratio, moments.rays, moments.variance, radius, size)
    traced = light.reshape(*size, 3), ratio.reshape(size), moments.rays.reshape(size)
    return composite_breda(image, post, traced, depth, defocus, focus, fields[2]).reshape(-1, 3)


def _disparity_in_focus(lens: LensModel) -> float:
    """Return the inverse depth of zero circle of confusion, which is linear in it."""
    at_infinity, slope = float(lens.coc_radius(0.0)), float(lens.coc_radius(1.0) - lens.coc_radius(0.0))
    return -at_infinity / slope


def _fraction_of_rays(
    moments: _Moments,
    ray_fraction: np.ndarray,
    post: np.ndarray,
    size: tuple[int, int],
    rule: str,
    frame: int,
) -> np.ndarray:
    """Return the fraction of the maximum rays of each pixel in a frame: (5.10), or by remaining noise."""
    if frame == 0:
        return ray_fraction
    if rule != "ours":
        variance = gaussian(moments.variance.reshape(size), 1.0).ravel()
        return np.clip(ray_fraction + _RAY_VARIANCE_WEIGHT * variance, 0, 1) * (ray_fraction > 0)
    noise, ray_weight = _expected_error(moments, post, size)
    return np.clip(noise * (ray_weight + _MIN_RAY_FRACTION) / _TARGET_VARIANCE, 0, 1) * (ray_fraction > 0)


def _capped(
    allocation: Allocation, variance: np.ndarray, sent: np.ndarray, budget: int, max_rays: int
) -> np.ndarray:
    """Return the number of rays of each pixel, at most ``max_rays``; redistributes the excess."""
    counts = np.zeros(len(sent), np.int64)
    for _ in range(_REDISTRIBUTION_ITERATIONS):
        remaining = budget - int(counts.sum())
        counts = np.minimum(
            counts + allocation(variance * (counts < max_rays), sent + counts, remaining), max_rays
        )
    return counts


def _visible_variance(moments: _Moments, post: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the local mean variance of one ray's luminance, weighted by the blend, (H * W,)."""
    ray_weight = _expected_error(moments, post, size)[1]
    visible: np.ndarray = (ray_weight + _MIN_RAY_FRACTION) ** 2 * _local_mean(moments.variance, size)
    return visible


def _smoothed(
    light: np.ndarray,
    ratio: np.ndarray,
    sent: np.ndarray,
    variance: np.ndarray,
    radius: np.ndarray,
    size: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray]:
    """Return light and ratio smoothed by a Gaussian over neighbours whose blur reaches the pixel.

    The noise determines the strength. Pixels without rays are excluded, which avoids dark rims, the reason
    why the thesis omits the median.
    """
    has_rays = sent.reshape(size) > 0
    values = np.concatenate([light, ratio[:, None]], 1).reshape(*size, 4)
    reach = radius.reshape(size)
    mean = float(reach[has_rays].mean()) if has_rays.any() else 0.0
    kernel = int(min(_MAX_SMOOTHING_RADIUS_PX, np.ceil(mean)))
    sums, weights = np.zeros_like(values), np.zeros(size)
    padded = [
        np.pad(part, [(kernel, kernel)] * 2 + [(0, 0)] * (part.ndim - 2))
        for part in (values, has_rays.astype(float), reach)
    ]
    for dy in range(-kernel, kernel + 1):
        for dx in range(-kernel, kernel + 1):
            distance = np.hypot(dx, dy)
            if distance > kernel:
                continue
            rows, columns = (slice(kernel + d, kernel + d + n) for d, n in zip((dy, dx), size, strict=True))
            neighbours, valid, blur = (part[rows, columns] for part in padded)
            weight = valid * (blur >= distance) * np.exp(-2 * (distance / max(kernel, 1)) ** 2)
            sums += weight[..., None] * neighbours
            weights += weight
    strength = np.clip(_SMOOTHING_VARIANCE_WEIGHT * variance, 0, _MAX_SMOOTHING).reshape(size)[..., None]
    smoothed = sums / np.maximum(weights, 1e-9)[..., None]
    result = np.where(weights[..., None] > 0, values + strength * (smoothed - values), values).reshape(-1, 4)
    return result[:, :3], result[:, 3]


def _published_ray_weight(sent: np.ndarray, ratio: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Return the weight of the rays: 1 in the near field, otherwise ``1 - smoothstep(0, 0.3, h)``."""
    t = np.clip(ratio / _HIT_RATIO, 0, 1)
    return np.where(sent > 0, np.where(defocus > 0, 1.0, 1.0 - t * t * (3.0 - 2.0 * t)), 0.0)


def _expected_error(
    moments: _Moments, post: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of the rays' mean luminance, and their optimal weight; both (H * W,).

    The local mean squared difference between rays and post-process is the error e^2 of the post-process plus
    the noise v of the rays; the blend of minimum error weights the rays with ``e^2 / (e^2 + v)``.

    Source:
        James and Stein, "Estimation with quadratic loss", 1961.
    """
    sent = moments.rays
    noise = moments.variance * sent / np.maximum(sent - 1, 1) / np.maximum(sent, 1)
    square = ((moments.merged()[0] - post) @ _LUMINANCE) ** 2
    fraction = np.maximum(_local_mean((sent > 1).astype(float), size), 1e-6)
    noise = _local_mean(np.where(sent > 1, noise, 0), size) / fraction
    square = _local_mean(np.where(sent > 1, square, 0), size) / fraction
    error = np.maximum(square - noise, 0)
    return noise, np.where(sent > 1, error / np.maximum(error + noise, 1e-12), 0)


def _local_mean(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return gaussian(values.reshape(size), _ERROR_SIGMA_PX).ravel()
