"""Rays renderer: scatter on single surfaces, pupil rays through layers near depth discontinuities."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, Unpack

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.arrays.viewport import Viewport
from bokehnet.checks import check_same_size
from bokehnet.classical.base import ALIGNED, ClassicalOptions, ClassicalResult, Strip, check_inputs
from bokehnet.classical.error_map import boundary_threshold, geometric_error_map
from bokehnet.classical.fringed_scatter import chromatic_fringes, fringed_scatter
from bokehnet.classical.highlights.lights import add_lights, separate_lights
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.mixed_pixels import to_known_surfaces
from bokehnet.classical.layered.layers import Layers, split_picture
from bokehnet.classical.layered.march.aberrated_rays import lens_table
from bokehnet.classical.layered.march.bundle_extents import bundle_extents, reach_by_rings, stray_map
from bokehnet.classical.layered.march.defocus_bins import TILE, occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.layered.march.ray_averages import window_halo
from bokehnet.classical.layered.march.ray_marching import SETS, march
from bokehnet.classical.layered.march.smooth_tiles import render_smooth_tiles
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.fusion import fuse
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture, pupil_points
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter
from bokehnet.optics.sampling import sobol

__all__ = ["CPU", "Device", "rays", "render_rays", "scatter_beyond"]


class Device(NamedTuple):
    """Functions that scatter and march on a device.

    Attributes:
        scatter: Same signature as :func:`bokehnet.classical.scatter_renderer.scatter`.
        march: Kernel that sends rays, see ``send`` of
            :func:`bokehnet.classical.layered.march.ray_marching.march`; ``None`` for the kernel on the CPU.
    """

    scatter: Callable[..., np.ndarray]
    march: Callable[..., None] | None


CPU = Device(scatter, None)

# Rays per pixel where no window of pixels is averaged. Rays through an aberrated lens cost more, and
# noise-free bundles serve the areas away from depth edges; with dispersion one ray counts as three.
_RAYS, _LENS_RAYS, _COLORED_RAYS = 64, 48, 32

# Upper bound of the rays per pixel, as a factor on these numbers.
_MAX_RAYS_FACTOR = 2

# Behind an aberrated lens every light has a point spread function of its own, which must be computed; fainter
# lights are left to the rays and raise their noise by 0.001 or less.
_MIN_LIGHT_BRIGHTNESS = 0.02

# Largest blur radius in units of the picture's longer side; beyond it every ray ends outside the picture.
_MAX_RADIUS_IN_SIDES = 4.0

# Number of scramblings of the sampling pattern; each pixel selects one at random.
_VARIANTS = 8


@lru_cache(maxsize=8)
def _pattern(aperture: Aperture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rays of a pixel as points of one low-discrepancy sequence, so that any prefix is even.

    Returns:
        Pupil points (2, SETS * variants, rays); their weights in front of and behind focus, same shape; and
        three more random numbers of each ray, (SETS * variants * rays, 3).
    """
    rays_per_pixel = _MAX_RAYS_FACTOR * _RAYS
    count = SETS * rays_per_pixel
    cube = np.concatenate([sobol(count, np.random.default_rng(seed), 5) for seed in range(_VARIANTS)])
    sides = [pupil_points(aperture, cube[:, :2], side) for side in (1, -1)]
    points = sides[0][0].reshape(-1, rays_per_pixel, 2).transpose(2, 0, 1).astype(np.float32)
    weights = np.stack([side[1].reshape(-1, rays_per_pixel) for side in sides]).astype(np.float32)
    return np.ascontiguousarray(points), weights, cube[:, 2:]


def rays(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    *,
    aperture: Aperture | None = None,
    lens_response: LensResponse | None = None,
    seed: int = 0,
    layers: Layers | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> npt.NDArray[np.float32]:
    """Render bokeh with occlusion: foregrounds are translucent, sharp subjects keep clean edges.

    Pixels within the blur's reach of a depth discontinuity (:func:`geometric_error_map`) send 8 to 128 rays
    each through the pupil, more where the noise is higher; where surfaces are blurred, the rays of
    neighbouring pixels are averaged. Bright lights are splatted whole. All other pixels come from the
    scatter, and a soft mask joins the two. Beyond its border the picture continues with its border pixels.
    Not differentiable; the scatter is.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Shape of the aperture; default: a disc.
        lens_response: Response of the lens; default: a perfect lens. Where its rays deviate by half a pixel
            or more, every pixel is rendered by rays: away from depth discontinuities by those of a whole
            tile. Where they deviate less, rays and scatter are blended.
        seed: Seed of the noise; two seeds differ by noise only.
        layers: True layers, from a renderer that sees occluded surfaces. Default: estimated from the picture
            (:func:`bokehnet.classical.layered.layers.split_layers`).
        pixel_filter: Pixel filter of the picture, which mixes both surfaces at edges.
        known: Known surfaces of pixels at edges, which are not estimated; only without ``layers``.

    Returns:
        Picture (H, W, 3) float32.

    Raises:
        ShapeError: The sizes do not fit.
        ParameterError: NaN or infinity in image or defocus.

    Source:
        Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
        through layers of pictures; Peng et al., "BokehMe", CVPR 2022, for where the scatter is wrong.
    """
    look = (aperture or Aperture(), lens_response, seed, layers)
    return _render(image, defocus, *look, pixel_filter=pixel_filter, known=known).bokeh


_fuse = njit()(fuse)


@njit(cache=True, parallel=True)
def _blend(smooth, error_map, rays_mask, result):  # type: ignore[no-untyped-def]
    """Blend the rays in ``result`` with the scatter ``smooth``, by the weight ``error_map``."""
    for y in prange(rays_mask.shape[0]):
        for x in range(rays_mask.shape[1]):
            if rays_mask[y, x]:
                for c in range(3):
                    result[y, x, c] = _fuse(smooth[y, x, c], result[y, x, c], error_map[y, x])


def _seconds(pixels: int, marched: int, radius: int) -> tuple[float, float, float, float]:
    """Return the approximate relative cost of scatter, layers, rays and lights, for a progress bar only."""
    lights = (0.1 + 0.002 * radius) * 1e-6 * pixels
    return 0.25e-6 * pixels, 0.35e-6 * pixels, (0.2 + 0.006 * radius) * 1e-6 * marched, lights


def _stage_progress(
    progress: Callable[[float], None] | None, seconds: tuple[float, ...]
) -> Callable[[int, float], None]:
    """Return a callback that receives the stage and its completed fraction."""

    def report(stage: int, fraction: float) -> None:
        if progress is not None:
            progress((sum(seconds[:stage]) + fraction * seconds[stage]) / sum(seconds))

    return report


def scatter_beyond(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture,
    reach: int,
    strip: Strip | None,
    viewport: Viewport,
    scattered: Callable[..., np.ndarray] = scatter,
) -> np.ndarray:
    """Scatter a picture whose border pixels are repeated outwards, as the rays see it.

    A cat's-eye is measured from the corners of the picture itself, so such pictures keep their size. Where a
    strip ends inside the picture nothing is repeated, but rows are omitted so that blocks align with those of
    the whole picture.

    Args:
        image: Scene-linear picture, (H, W, 3) float32.
        defocus: Signed blur radius, (H, W) pixels.
        aperture: Shape of the aperture.
        reach: Number of repeated pixels.
        strip: Position of these rows in their picture; ``None`` for all rows.
        viewport: Position of the arrays in the shown picture.
        scattered: Function that scatters, as :func:`bokehnet.classical.scatter_renderer.scatter`.
    """
    if reach == 0 or aperture.cats_eye > 0:
        return scattered(image, defocus, aperture, viewport)
    above = below = reach
    skipped = 0
    if strip is not None and strip.first > 0:
        above, skipped = 0, -(reach + strip.first) % ALIGNED
    if strip is not None and strip.last < strip.height:
        below = 0
    padding = ((above, below), (reach, reach))
    larger = scattered(
        np.pad(image[skipped:], (*padding, (0, 0)), "edge"),
        np.pad(defocus[skipped:], padding, "edge"),
        aperture,
    )
    inside = larger[above : len(larger) - below, reach:-reach]
    return inside if skipped == 0 else np.concatenate([image[:skipped], inside])


def _render(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture,
    lens_response: LensResponse | None = None,
    seed: int = 0,
    layers: Layers | None = None,
    strip: Strip | None = None,
    viewport: Viewport | None = None,
    progress: Callable[[float], None] | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
    rays_factor: float = 1.0,
    device: Device = CPU,
) -> ClassicalResult:
    image, defocus = (np.asarray(array, np.float32) for array in check_inputs(image, defocus))
    if layers is not None:
        check_same_size("image", image, "layers", layers.defocus)
    size = defocus.shape if strip is None else (strip.height, defocus.shape[1])
    largest = _MAX_RADIUS_IN_SIDES * max(size)
    defocus = np.clip(defocus, -largest, largest)
    nearest, farthest = defocus, defocus
    if known is not None:
        known.check_within(*defocus.shape)
        known = known.with_radius_limit(largest)
        nearest, farthest = known.near_and_far_maps(defocus)
    radius = strip.max_coc_radius if strip is not None else _largest_radius(nearest, farthest)
    above = 0 if strip is None else strip.first
    viewport = viewport or Viewport.whole(*size)
    error_map = rays_weight = geometric_error_map(nearest, boundary_threshold(size), farthest=farthest)
    colored = lens_response is not None and lens_response.is_dispersive
    points, weights, chances = _pattern(aperture)
    lens, ray_reach, fringes, nominal_rays = None, radius, None, _RAYS
    near = error_map
    if lens_response is not None and not lens_response.is_ideal:
        lens = lens_table(lens_response, viewport, chances, above=above, shape=defocus.shape)
        nominal_rays = _COLORED_RAYS if colored else _LENS_RAYS
        ray_reach = lens.reach(radius)
        extents = bundle_extents(points, lens)
        strays = stray_map(nearest, farthest, lens, extents, above)
        near = geometric_error_map(nearest, boundary_threshold(size), farthest=farthest, radii=strays)
        fringes = chromatic_fringes(lens_response, 1 / lens.scale)
        rays_weight = near
        if fringes is None:
            rays_weight = np.maximum(error_map, lens.visible_deviation(defocus.shape, radius, above))
        del strays
    del nearest, farthest
    reach = min(ray_reach if fringes is not None else radius, max(size))

    def scattered(radii: np.ndarray) -> np.ndarray:
        return scatter_beyond(image, radii, aperture, reach, strip, viewport.below(above), device.scatter)

    if fringes is None or lens is None:
        smooth = scattered(defocus)
    else:
        smooth = fringed_scatter(scattered, defocus, fringes, lens.maps, viewport.frame, above)
    rays_mask = rays_weight > 0
    seconds = _seconds(defocus.size, int(np.count_nonzero(rays_mask)), radius)
    report = _stage_progress(progress, seconds)
    report(0, 1)
    if strip is not None:  # keep the halo over which the rays of large discs are averaged
        halo = -(-window_halo(ray_reach) // TILE) * TILE
        rays_mask[: max(0, strip.output_rows.start - halo)] = rays_mask[strip.output_rows.stop + halo :] = (
            False
        )
    if not rays_mask.any():
        return ClassicalResult(
            bokeh=smooth,
            error_map=error_map,
            occluded_background=np.array(image),
            disocclusion_weight=np.zeros_like(error_map),
            scatter=smooth,
        )
    faintest = 0.0 if lens is None else _MIN_LIGHT_BRIGHTNESS
    mixed = None
    if layers is None:
        stack, mixed = split_picture(
            image, defocus, ray_reach, pixel_filter, known, lambda fraction: report(1, fraction)
        )
    else:
        stack = layers
    report(1, 1)
    rest, lights = separate_lights(stack, ray_reach, faintest, overwrite=layers is None)
    colors, cells = rest.colors, layer_cells(rest)
    del stack, rest
    result, disocclusion_weight = np.array(smooth), np.zeros_like(error_map)
    marched, bundled = rays_mask, None
    within: tuple[Any, ...] = ()
    if lens is not None:
        within = reach_by_rings(extents, lens, TILE, above)
    if lens is not None and fringes is None:
        near = render_smooth_tiles(
            colors,
            cells,
            rays_mask,
            near,
            points,
            weights,
            result,
            lens,
            extents,
            cats_eye=aperture.cats_eye,
            above=above,
            viewport=viewport,
        )
        marched, bundled = rays_mask & (near > 0), np.array(result)
    bins = occupied_bins(cells, *within)
    march(
        colors,
        cells,
        marched,
        bins,
        points,
        weights,
        result,
        disocclusion_weight=disocclusion_weight,
        cats_eye=aperture.cats_eye,
        lens=lens,
        seed=seed,
        above=above,
        viewport=viewport,
        radius=ray_reach,
        nominal_rays=round(rays_factor * nominal_rays),
        progress=lambda fraction: report(2, fraction),
        send=device.march,
    )
    if bundled is not None:
        with parallel_region:
            _blend(bundled, near, marched, result)
        del bundled
    add_lights(
        lights,
        cells,
        rays_mask,
        bins,
        aperture,
        result,
        lens_response=lens_response,
        viewport=viewport.below(above),
        progress=lambda fraction: report(3, fraction),
    )
    with parallel_region:
        _blend(smooth, rays_weight, rays_mask, result)
    occluded_background = np.ascontiguousarray(colors[:, :, min(1, colors.shape[2] - 1)])
    return ClassicalResult(
        bokeh=result,
        error_map=error_map,
        occluded_background=occluded_background,
        disocclusion_weight=disocclusion_weight,
        mixed_pixels=None if mixed is None else to_known_surfaces(mixed),
        scatter=smooth,
    )


def _largest_radius(nearest: np.ndarray, farthest: np.ndarray) -> int:
    """Return the largest blur radius in pixels, rounded up."""
    return math.ceil(max(float(nearest.max()), -float(farthest.min()), 0.0))


def render_rays(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    device: Device = CPU,
    **options: Unpack[ClassicalOptions],
) -> ClassicalResult:
    """Render with rays and return the complete result; arguments and errors as for :func:`rays`."""
    return _render(image, defocus, aperture or Aperture(), device=device, **options)
