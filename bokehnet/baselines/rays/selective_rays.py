"""A hybrid of post-process and rays: rays go into the scene where the post-process can be wrong.

A mask says how many rays a pixel may have, the variance of what they brought so far how many it gets. They
are Cook's: from a point of the pupil through the pixel's point in focus. What they meet before the plane of
focus is the near field, the rest the far field; the share of near hits merges both. Noise is smoothed where
the variance is high, and the rays are laid over the post-process.

Faults as published: the mask misses edges between parallel surfaces, and all of a wide blur but its middle;
what is sharp by its depth stays sharp under a near blur; smoothing knows no edges.

Source: Tan et al., "A hybrid system for real-time rendering of depth of field effect in games", 2022, as
thesis 000 gives it, 5.0.2, 5.0.3 and 5.1.2. Half resolution and temporal anti-aliasing are left out: all is
of full size. What the last frame brought is taken over by :mod:`bokehnet.baselines.rays.reprojection`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from bokehnet.baselines.gather.scatter_as_you_gather import tan
from bokehnet.baselines.rays.ray_mask import gaussian, in_mixed_tiles, ray_mask
from bokehnet.baselines.rays.reprojection import History
from bokehnet.checks import check_above, check_choice, check_same_size, check_whole
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.lenses.base import LensModel
from bokehnet.optics.pixels.sample_allocation import Allocation
from bokehnet.optics.sampling import disc_from_square

__all__ = ["RULES", "SelectiveResult", "TraceRays", "lens_rays", "selective_rays", "traced"]

# Origins and directions (N, 3), mm; out come scene-linear colours (N, 3), depths (N,), mm, and whether
# anything was hit, (N,).
TraceRays = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]

RULES = ("tan", "ours")

# Weights of the variance: for rays (5.10), and for smoothing with its largest share (5.13).
_FOR_RAYS, _FOR_SMOOTHING, _MOST_SMOOTHED = 1e5, 2e3, 0.9

# Share of near hits beyond which a far pixel takes the post-process.
_HIT_RATIO = 0.3

# Smoothing looks no farther than this, pixels; and the radius of a blur that is as good as sharp.
_FARTHEST, _SHARP = 6, 0.5 * np.sqrt(2)

# Variance of the mean, in luminance, below which a pixel has rays enough; window over which errors are
# expected alike, pixels; and what part of its rays a pixel keeps whose post-process seems right.
_ENOUGH, _WINDOW, _LEAST_DOUBT = 2e-5, 2.0, 0.1

# How often what a pixel may not send is given to others.
_ROUNDS = 4

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, kw_only=True)
class SelectiveResult:
    """What the hybrid made.

    Attributes:
        bokeh: (H, W, 3), scene-linear.
        post_process: What it set out from.
        rays: How many each pixel sent, (H, W).
        hit_ratio: Share of those that met something before the plane of focus, (H, W); 0 where none was sent.
        variance: Of one ray's luminance, (H, W).
        history: What the rays brought, for the next frame of a scene that moves.
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
    """Origins and directions (N, 3), mm, of one ray for each pixel (N,), anywhere in it and in the pupil."""
    height, width = size
    y, x = np.divmod(pixels, width)
    jitter = rng.random((len(pixels), 4))
    place = np.stack([x - 0.5 * width, y - 0.5 * height], -1) + jitter[:, :2]
    rays = lens.sample_rays(-pixel_pitch * place, disc_from_square(jitter[:, 2:]))
    zero, one = np.zeros((len(pixels), 1)), np.ones((len(pixels), 1))
    origin = np.broadcast_to(rays.origin, (len(pixels), 2))
    return np.concatenate([origin, zero], 1), np.concatenate([rays.slope, one], 1)


def traced(
    trace_rays: TraceRays, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a callback answers, checked.

    Raises:
        ParameterError: It raised, or answered anything but three arrays, or NaN, or hits at no depth.
        ShapeError: The arrays are not (N, 3), (N,) and (N,).
    """
    try:
        answer = trace_rays(origins, directions)
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
        raise ParameterError("trace_rays", "colour, depth and hit of each ray", shown=found) from error
    if not isinstance(answer, tuple) or len(answer) != 3:
        raise ParameterError(
            "trace_rays", "colour, depth and hit of each ray", shown=f"a {type(answer).__name__}"
        )
    color, depth, hit = (np.asarray(part) for part in answer)
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
            "trace_rays", "finite colours, and depths above 0 where it hits", shown=f"{bad} rays with others"
        )
    return color, np.where(hit, depth, np.inf), hit


class _Moments:
    """Sums over the rays so far of each pixel: near and far field, and the luminance's two moments."""

    def __init__(self, pixels: int) -> None:
        self.light = np.zeros((2, pixels, 3))  # near, far
        self.count = np.zeros((2, pixels))
        self.first, self.second = np.zeros(pixels), np.zeros(pixels)

    def take(self, history: History) -> None:
        """Set out from the sums of another frame."""
        self.light, self.count = history.light.copy(), history.count.copy()
        self.first, self.second = history.first.copy(), history.second.copy()

    def add(self, pixels: np.ndarray, color: np.ndarray, near: np.ndarray) -> None:
        luminance = color @ _LUMINANCE
        for field, here in ((0, near), (1, ~near)):
            at = pixels[here]
            self.count[field] += np.bincount(at, minlength=len(self.first))
            for channel in range(3):
                self.light[field, :, channel] += np.bincount(at, color[here, channel], len(self.first))
        self.first += np.bincount(pixels, luminance, len(self.first))
        self.second += np.bincount(pixels, luminance**2, len(self.first))

    @property
    def rays(self) -> np.ndarray:
        total: np.ndarray = self.count.sum(0)
        return total

    @property
    def variance(self) -> np.ndarray:
        """Of one ray's luminance (5.12)."""
        count = np.maximum(self.rays, 1)
        return np.maximum(self.second / count - (self.first / count) ** 2, 0)

    def merged(self) -> tuple[np.ndarray, np.ndarray]:
        """Both fields by the hit ratio (5.5), and that."""
        ratio = self.count[0] / np.maximum(self.rays, 1)
        near, far = (self.light[i] / np.maximum(self.count[i], 1)[:, None] for i in (0, 1))
        return far + (near - far) * ratio[:, None], ratio


def selective_rays(
    image: np.ndarray,
    depth: np.ndarray,
    normals: np.ndarray,
    trace_rays: TraceRays,
    lens: LensModel,
    pixel_pitch: float,
    *,
    mask: str | np.ndarray = "sobel",
    rule: str = "tan",
    by_tile: bool = False,
    most: int = 5,
    frames: int = 8,
    budget: float | None = None,
    post_process: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    specular: np.ndarray | None = None,
    allocation: Allocation | None = None,
    history: History | None = None,
    seed: int = 0,
) -> SelectiveResult:
    """Render by post-process, and by rays where it is not to be trusted.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        depth: Of the same pixels along the axis, mm, (H, W), finite.
        normals: Of length 1, (H, W, 3).
        trace_rays: Answers for rays into the scene.
        lens: A perfect one, focused.
        pixel_pitch: mm.
        mask: Which pixels send rays: ``sobel``, ``sobel-depth`` or ``reach``, see
            :mod:`bokehnet.baselines.rays.ray_mask`; or what share of the most each may send, (H, W), 0 to 1.
        rule: ``tan``: as published. ``ours``: rays go where they are noisy and the post-process
            is seen to err, and the result is the mixture of both that errs least.
        by_tile: Tiles of one depth send no rays (:func:`bokehnet.baselines.rays.ray_mask.in_mixed_tiles`),
            and
            Tan's post-process treats each tile as it needs.
        most: Rays of a pixel a frame, from 1 up.
        frames: Accumulated of a scene that stands still, from 1 up.
        budget: Rays of a pixel over all frames, in the mean of the picture, that are not to be passed.
        post_process: Blurs a picture by its defocus in pixels; default: Tan's.
        specular: Pixels whose lights take the post-process, as published, (H, W) bool.
        allocation: With ``ours``, from the second frame on: which pixels send the rays of a frame, by how
            much their noise shows in the mixture (:mod:`bokehnet.optics.pixels.sample_allocation`). None:
            each as many as would make its own noise invisible.
        history: Of the last frame, moved to this one (:mod:`bokehnet.baselines.rays.reprojection`).
        seed: Of the rays.

    Raises:
        ParameterError: A wrong choice or number; what is wrong with ``trace_rays``.
        ShapeError: Sizes that differ.
    """
    check_choice("rule", rule, RULES)
    check_whole("most", most, 1)
    check_whole("frames", frames, 1)
    if budget is not None:
        check_above("budget", budget, 0)
    for name, array in (("depth", depth), ("normals", normals)):
        check_same_size("image", image, name, array)
    defocus = np.asarray(lens.coc_radius(1 / np.asarray(depth, np.float64)) / pixel_pitch, np.float32)
    size = defocus.shape
    blurred = post_process or partial(tan, by_tile=by_tile)
    post = blurred(np.asarray(image, np.float32), defocus)
    wanted = ray_mask(mask, normals, depth, defocus).ravel()
    if by_tile:
        wanted = wanted * in_mixed_tiles(defocus).ravel()
    focus = float(1 / _disparity_in_focus(lens))
    moments, rng = _Moments(defocus.size), np.random.default_rng(seed)
    if history is not None:
        check_same_size("image", image, "history", history.depth)
        moments.take(history)
    sent_before = moments.rays
    for frame in range(frames):
        share = _share(moments, wanted, post.reshape(-1, 3), size, rule, frame)
        counts = np.round(share * most)
        if allocation is not None and rule == "ours" and frame:
            limit = counts.sum()
            if budget is not None:  # what earlier frames left goes on
                limit = (budget * (frame + 1) / frames) * defocus.size - (moments.rays - sent_before).sum()
            shown = _shown_variance(moments, post.reshape(-1, 3), size) * (wanted > 0)
            counts = _capped(allocation, shown, moments.rays, int(limit), most)
        elif budget is not None and counts.mean() > budget / frames:
            counts = np.floor(share * most * (budget / frames / counts.mean()) + rng.random(defocus.size))
        pixels = np.repeat(np.arange(defocus.size), counts.astype(np.int64))
        if len(pixels):
            origins, directions = lens_rays(lens, size, pixel_pitch, pixels, rng)
            color, found, _ = traced(trace_rays, origins, directions)
            moments.add(pixels, color, found < focus)
    merged, ratio = moments.merged()
    sent, variance = moments.rays, moments.variance
    flat = post.reshape(-1, 3)
    if rule == "tan":
        radius = np.abs(defocus).ravel()
        light, ratio = _smoothed(merged, ratio, sent, variance, radius, size)
        take = _published(sent, ratio, defocus.ravel())
    else:
        light, take = merged, _expected_error(moments, flat, size)[1]
    if specular is not None:
        check_same_size("image", image, "specular", specular)
        take = np.where(np.ravel(specular), 0.0, take)
    result = flat + take[:, None] * (light - flat)
    sharp = (np.abs(defocus).ravel() <= _SHARP) & ((rule == "tan") | (sent == 0))
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


def _disparity_in_focus(lens: LensModel) -> float:
    """Inverse depth at which the circle of confusion vanishes; that is linear in it."""
    at_infinity, slope = float(lens.coc_radius(0.0)), float(lens.coc_radius(1.0) - lens.coc_radius(0.0))
    return -at_infinity / slope


def _share(
    moments: _Moments, wanted: np.ndarray, post: np.ndarray, size: tuple[int, int], rule: str, frame: int
) -> np.ndarray:
    """Share of the most rays that pixels get in a frame (5.10), or, as ours, those that still need some."""
    if frame == 0:
        return wanted
    if rule == "tan":
        variance = gaussian(moments.variance.reshape(size), 1.0).ravel()
        return np.clip(wanted + _FOR_RAYS * variance, 0, 1) * (wanted > 0)
    noise, taken = _expected_error(moments, post, size)
    return np.clip(noise * (taken + _LEAST_DOUBT) / _ENOUGH, 0, 1) * (wanted > 0)


def _capped(
    allocation: Allocation, variance: np.ndarray, sent: np.ndarray, budget: int, most: int
) -> np.ndarray:
    """Rays of each pixel, none with more than ``most``; what that cuts off goes to the others."""
    counts = np.zeros(len(sent), np.int64)
    for _ in range(_ROUNDS):
        left = budget - int(counts.sum())
        counts = np.minimum(counts + allocation(variance * (counts < most), sent + counts, left), most)
    return counts


def _shown_variance(moments: _Moments, post: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Variance of one ray's luminance, mean around each pixel, as far as the mixture shows it, (H * W,)."""
    taken = _expected_error(moments, post, size)[1]
    shown: np.ndarray = (taken + _LEAST_DOUBT) ** 2 * _around(moments.variance, size)
    return shown


def _smoothed(
    light: np.ndarray,
    ratio: np.ndarray,
    sent: np.ndarray,
    variance: np.ndarray,
    radius: np.ndarray,
    size: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray]:
    """Spatial reconstruction: a Gaussian over neighbours whose blur reaches the pixel, as far as noise asks.

    Pixels without rays take no part, so that no dark rims grow, for which the thesis left out the median.
    """
    traced_here = sent.reshape(size) > 0
    values = np.concatenate([light, ratio[:, None]], 1).reshape(*size, 4)
    reach = radius.reshape(size)
    mean = float(reach[traced_here].mean()) if traced_here.any() else 0.0
    kernel = int(min(_FARTHEST, np.ceil(mean)))
    sums, weights = np.zeros_like(values), np.zeros(size)
    padded = [
        np.pad(part, [(kernel, kernel)] * 2 + [(0, 0)] * (part.ndim - 2))
        for part in (values, traced_here.astype(float), reach)
    ]
    for dy in range(-kernel, kernel + 1):
        for dx in range(-kernel, kernel + 1):
            distance = np.hypot(dx, dy)
            if distance > kernel:
                continue
            rows, columns = (slice(kernel + d, kernel + d + n) for d, n in zip((dy, dx), size, strict=True))
            there, known, blur = (part[rows, columns] for part in padded)
            weight = known * (blur >= distance) * np.exp(-2 * (distance / max(kernel, 1)) ** 2)
            sums += weight[..., None] * there
            weights += weight
    share = np.clip(_FOR_SMOOTHING * variance, 0, _MOST_SMOOTHED).reshape(size)[..., None]
    around = sums / np.maximum(weights, 1e-9)[..., None]
    result = np.where(weights[..., None] > 0, values + share * (around - values), values).reshape(-1, 4)
    return result[:, :3], result[:, 3]


def _published(sent: np.ndarray, ratio: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Share of the rays: all in the near field; else ``1 - smoothstep(0, 0.3, h)``."""
    t = np.clip(ratio / _HIT_RATIO, 0, 1)
    return np.where(sent > 0, np.where(defocus > 0, 1.0, 1.0 - t * t * (3.0 - 2.0 * t)), 0.0)


def _expected_error(
    moments: _Moments, post: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the rays' mean luminance, and their best share beside the post-process; both (H * W,).

    Around a pixel the mean square of what both differ by is the error e^2 of the post-process and the noise v
    of the rays; the mixture that errs least takes ``e^2 / (e^2 + v)`` of the rays.

    Source:
        James and Stein, "Estimation with quadratic loss", 1961.
    """
    sent = moments.rays
    noise = moments.variance * sent / np.maximum(sent - 1, 1) / np.maximum(sent, 1)
    square = ((moments.merged()[0] - post) @ _LUMINANCE) ** 2
    known = np.maximum(_around((sent > 1).astype(float), size), 1e-6)
    noise = _around(np.where(sent > 1, noise, 0), size) / known
    square = _around(np.where(sent > 1, square, 0), size) / known
    error = np.maximum(square - noise, 0)
    return noise, np.where(sent > 1, error / np.maximum(error + noise, 1e-12), 0)


def _around(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return gaussian(values.reshape(size), _WINDOW).ravel()
