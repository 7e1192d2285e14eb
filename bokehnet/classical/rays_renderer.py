"""Rays renderer: scatter on single surfaces, pupil rays through layers near depth discontinuities."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.arrays.fusion import fuse
from bokehnet.arrays.viewport import Viewport
from bokehnet.checks import check_same_size
from bokehnet.classical.base import MAX_RADIUS_IN_SIDES, ClassicalOptions, ClassicalResult, check_inputs
from bokehnet.classical.error_map import boundary_threshold, geometric_error_map
from bokehnet.classical.fringed_scatter import Fringes, chromatic_fringes, fringed_scatter
from bokehnet.classical.highlight_detection import light_limit
from bokehnet.classical.highlights.lights import add_lights, separate_lights
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.mixed_pixels import to_known_surfaces
from bokehnet.classical.layered.layers import Layers, RaysWindow, split_picture
from bokehnet.classical.layered.march.aberrated_rays import LensTable, lens_table
from bokehnet.classical.layered.march.bundle_extents import (
    bundle_extents,
    reach_by_rings,
    sharp_limits,
    stray_map,
)
from bokehnet.classical.layered.march.defocus_bins import TILE, DefocusBins, occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.layered.march.ray_marching import SETS, RaysJob, march
from bokehnet.classical.layered.march.resolution_levels import (
    BLOCK_PX,
    SharpLimitsAt,
    levels_halo,
    make_levels,
    march_levels,
)
from bokehnet.classical.layered.march.smooth_tiles import render_smooth_tiles
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.picture_job import CPU, Device, PictureJob
from bokehnet.classical.scatter_renderer import scatter_beyond
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture, pupil_points
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter
from bokehnet.optics.sampling import sobol

__all__ = ["pupil_pattern", "rays", "render_rays"]


# Rays per pixel where no window of pixels is averaged. Rays through an aberrated lens cost more, and
# noise-free bundles serve the areas away from depth edges; with dispersion one ray counts as three.
_RAYS, _LENS_RAYS, _COLORED_RAYS = 64, 48, 32

# Upper bound of the rays per pixel, as a factor on these numbers.
_MAX_RAYS_FACTOR = 2

# Behind an aberrated lens every light has a point spread function of its own, which must be computed; fainter
# lights are left to the rays and raise their noise by 0.001 or less.
_MIN_LIGHT_BRIGHTNESS = 0.02

# Number of scramblings of the sampling pattern; each pixel selects one at random.
_VARIANTS = 8


@lru_cache(maxsize=8)
def pupil_pattern(aperture: Aperture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    job = PictureJob(
        image=image,
        defocus=defocus,
        aperture=aperture or Aperture(),
        lens_response=lens_response,
        seed=seed,
        layers=layers,
        pixel_filter=pixel_filter,
        known=known,
    )
    return _render(job).bokeh


_fuse = njit()(fuse)


@njit(cache=True, parallel=True)
def _blend(smooth, error_map, rays_mask, result):
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


@dataclass(frozen=True, kw_only=True, slots=True)
class _Rays:
    """Rays of a render: pattern in the pupil, lens, and the pixels that they serve.

    Attributes:
        points: See :func:`pupil_pattern`.
        weights: See :func:`pupil_pattern`.
        lens: Lens of the rays; ``None`` for a perfect one.
        fringes: Colour fringes, if the lens has nothing else.
        extents: Extents of the bundles of smooth tiles; ``None`` for a perfect lens.
        radius: Largest blur radius of a perfect lens in the whole picture, pixels.
        reach: Maximum distance of a pixel's rays from it, pixels.
        nominal: Nominal number of rays per pixel.
        near: Weight of the rays near depth discontinuities, (H, W).
        weight: Weight of the rays over the scatter, (H, W).
    """

    points: np.ndarray
    weights: np.ndarray
    lens: LensTable | None = None
    fringes: Fringes | None = None
    extents: np.ndarray | None = None
    radius: int
    reach: int
    nominal: int
    near: np.ndarray
    weight: np.ndarray


def _render(job: PictureJob) -> ClassicalResult:
    surroundings = _checked(job)
    window = surroundings.reached()
    job = surroundings if job.strip is None else surroundings.cropped(*window)
    nearest, farthest = job.defocus, job.defocus
    if job.known is not None:
        nearest, farthest = job.known.near_and_far_maps(job.defocus)
    if job.strip is None:
        radius = math.ceil(max(float(nearest.max()), -float(farthest.min()), 0.0))
    else:
        radius = job.strip.max_coc_radius
    error_map = geometric_error_map(nearest, boundary_threshold(job.size), farthest=farthest)
    pupil_rays = _make_rays(job, radius, nearest, farthest, error_map)
    del nearest, farthest
    smooth = _scatter_smooth(job, pupil_rays, radius)
    rays_mask = pupil_rays.weight > 0
    if job.strip is not None:  # around the output, the pixels over which the rays of large discs are averaged
        halo = -(-levels_halo(pupil_rays.reach) // TILE) * TILE
        rows, columns = job.strip.output
        for lines, span in ((rays_mask, rows), (rays_mask.T, columns)):
            lines[: max(0, span.start - halo)] = False
            lines[span.stop + halo :] = False
    seconds = _seconds(surroundings.defocus.size, int(np.count_nonzero(rays_mask)), radius)
    report = _stage_progress(job.progress, seconds)
    report(0, 1)
    if rays_mask.any():
        layers_of = partial(_visible_layers, surroundings, window, pupil_rays)
        result = _render_layers(job, layers_of, pupil_rays, smooth, error_map, rays_mask, report)
    else:
        result = ClassicalResult(
            bokeh=smooth,
            error_map=error_map,
            occluded_background=np.array(job.image),
            disocclusion_weight=np.zeros_like(error_map),
            scatter=smooth,
        )
    return result if job.strip is None else result.part(*job.strip.output)


def _checked(job: PictureJob) -> PictureJob:
    """Return the job with checked arrays and bounded radii."""
    image, defocus = (np.asarray(array, np.float32) for array in check_inputs(job.image, job.defocus))
    if job.layers is not None:
        check_same_size("image", image, "layers", job.layers.defocus)
    largest = MAX_RADIUS_IN_SIDES * max(job.size)
    defocus, known = np.clip(defocus, -largest, largest), job.known
    if known is not None:
        known.check_within(*defocus.shape)
        known = known.with_radius_limit(largest)
    return replace(job, image=image, defocus=defocus, known=known)


def _make_rays(
    job: PictureJob, radius: int, nearest: np.ndarray, farthest: np.ndarray, error_map: np.ndarray
) -> _Rays:
    """Return the rays of a job whose largest blur radius is ``radius`` pixels."""
    points, weights, chances = pupil_pattern(job.aperture)
    rays = partial(_Rays, points=points, weights=weights, radius=radius)
    response = job.lens_response
    if response is None or response.is_ideal:
        return rays(reach=radius, nominal=_RAYS, near=error_map, weight=error_map)
    shape = job.defocus.shape
    lens = lens_table(response, job.picture_viewport, chances, above=job.above, shape=shape)
    extents = bundle_extents(points, lens)
    strays = stray_map(nearest, farthest, lens, extents, job.above)
    near = geometric_error_map(nearest, boundary_threshold(job.size), farthest=farthest, radii=strays)
    fringes = chromatic_fringes(response, 1 / lens.scale)
    weight = near
    if fringes is None:
        weight = np.maximum(error_map, lens.visible_deviation(shape, radius, job.above))
    return rays(
        lens=lens,
        fringes=fringes,
        extents=extents,
        reach=lens.reach(radius),
        nominal=_COLORED_RAYS if response.is_dispersive else _LENS_RAYS,
        near=near,
        weight=weight,
    )


def _scatter_smooth(job: PictureJob, pupil_rays: _Rays, radius: int) -> np.ndarray:
    """Return the scatter of the picture, (H, W, 3), with colour fringes if the lens has nothing else."""
    reach = pupil_rays.reach if pupil_rays.fringes is not None else radius

    def scattered(radii: np.ndarray) -> np.ndarray:
        viewport = job.picture_viewport.below(job.above)
        return scatter_beyond(job.image, radii, job.aperture, reach, job.strip, viewport, job.device.scatter)

    if pupil_rays.fringes is None or pupil_rays.lens is None:
        return scattered(job.defocus)
    frame = job.picture_viewport.frame
    return fringed_scatter(scattered, job.defocus, pupil_rays.fringes, pupil_rays.lens.maps, frame, job.above)


def _visible_layers(
    surroundings: PictureJob,
    window: tuple[slice, slice],
    pupil_rays: _Rays,
    rays_mask: np.ndarray,
    report: Callable[[int, float], None],
) -> tuple[Layers, np.ndarray, KnownSurfaces | None]:
    """Return the layers of a window without lights, these, and the pixels that were unmixed.

    Args:
        surroundings: Job of the window and of what its occluded background depends on.
        window: Rows and columns of these arrays.
        pupil_rays: Rays of the render.
        rays_mask: Pixels of the window that send rays, (h, w).
        report: Callback that receives the stage and its completed fraction.
    """
    faintest = 0.0 if pupil_rays.lens is None else _MIN_LIGHT_BRIGHTNESS
    if surroundings.layers is not None:
        limit = light_limit(surroundings.layers.colors[:, :, 0], pupil_rays.reach)[window]
        return *separate_lights(surroundings.layers.part(*window), faintest=faintest, limit=limit), None
    layers, mixed, limit = split_picture(
        surroundings.image,
        surroundings.defocus,
        pupil_rays.reach,
        surroundings.pixel_filter,
        surroundings.known,
        lambda fraction: report(1, fraction),
        RaysWindow(*window, rays_mask),
    )
    rest, lights = separate_lights(layers, faintest=faintest, limit=limit, overwrite=True)
    return rest, lights, to_known_surfaces(mixed)


def _render_layers(
    job: PictureJob,
    layers_of: Callable[..., tuple[Layers, np.ndarray, KnownSurfaces | None]],
    pupil_rays: _Rays,
    smooth: np.ndarray,
    error_map: np.ndarray,
    rays_mask: np.ndarray,
    report: Callable[[int, float], None],
) -> ClassicalResult:
    """Return the scatter ``smooth`` with the rays through layers in the pixels of ``rays_mask``.

    ``layers_of`` is :func:`_visible_layers` of the job; it receives ``rays_mask`` and ``report``.
    """
    rest, lights, mixed = layers_of(rays_mask, report)
    report(1, 1)
    colors, cells = rest.colors, layer_cells(rest)
    levels = None
    if job.layers is None and job.device.march is None:
        levels = make_levels(rest, cells, _sharp_limits_at(job, pupil_rays))
    del rest  # its coverage and defocus are in the cells
    result, disocclusion_weight = np.array(smooth), np.zeros_like(error_map)
    within: tuple[Any, ...] = ()
    if pupil_rays.lens is not None and pupil_rays.extents is not None:
        within = reach_by_rings(pupil_rays.extents, pupil_rays.lens, TILE, job.above)
    bins = occupied_bins(cells, *within)
    rays_job = _rays_job(job, pupil_rays, colors, cells, rays_mask, bins)
    near, bundled = _bundle_smooth_tiles(rays_job, pupil_rays, result), None
    if near is not None:
        rays_job = replace(rays_job, rays_mask=rays_mask & (near > 0))
        is_both = rays_job.rays_mask & (near < 1)
        bundled = is_both, result[is_both], near[is_both][:, None]
    del near

    def report_rays(fraction: float) -> None:
        report(2, fraction)

    if levels is not None:
        lens_at = None if pupil_rays.lens is None else partial(_lens_at, job)
        march_levels(rays_job, levels, result, disocclusion_weight, report_rays, lens_at)
    else:
        march(rays_job, result, disocclusion_weight, progress=report_rays, send=job.device.march)
    del levels
    if bundled is not None:
        is_both, light, weight = bundled
        result[is_both] = fuse(light, result[is_both], weight)
        del bundled, is_both
    add_lights(
        lights,
        cells,
        rays_mask,
        bins,
        job.aperture,
        result,
        lens_response=job.lens_response,
        viewport=job.picture_viewport.below(job.above),
        progress=lambda fraction: report(3, fraction),
    )
    with parallel_region:
        _blend(smooth, pupil_rays.weight, rays_mask, result)
    return ClassicalResult(
        bokeh=result,
        error_map=error_map,
        occluded_background=np.ascontiguousarray(colors[:, :, min(1, colors.shape[2] - 1)]),
        disocclusion_weight=disocclusion_weight,
        mixed_pixels=mixed,
        scatter=smooth,
    )


def _sharp_limits_at(job: PictureJob, pupil_rays: _Rays) -> SharpLimitsAt | None:
    """Return the limits of what counts as sharp behind an aberrated lens; None for a perfect one."""
    if pupil_rays.lens is None or pupil_rays.extents is None:
        return None
    return partial(
        sharp_limits,
        side=BLOCK_PX,
        largest=pupil_rays.radius,
        extents=pupil_rays.extents,
        lens=pupil_rays.lens,
        above=job.above,
    )


def _lens_at(
    job: PictureJob, viewport: Viewport, above: int, shape: tuple[int, int]
) -> tuple[LensTable, tuple[Any, ...]]:
    """Return the lens of a smaller picture, and its extents as arguments of ``occupied_bins``."""
    assert job.lens_response is not None
    points, _, chances = pupil_pattern(job.aperture)
    lens = lens_table(job.lens_response, viewport, chances, above=above, shape=shape)
    return lens, reach_by_rings(bundle_extents(points, lens), lens, TILE, above)


def _rays_job(
    job: PictureJob,
    pupil_rays: _Rays,
    colors: np.ndarray,
    cells: np.ndarray,
    rays_mask: np.ndarray,
    bins: DefocusBins,
) -> RaysJob:
    """Return the job of the march through layers; arrays as in :class:`RaysJob`."""
    return RaysJob(
        colors=colors,
        cells=cells,
        rays_mask=rays_mask,
        bins=bins,
        points=pupil_rays.points,
        weights=pupil_rays.weights,
        radius=pupil_rays.reach,
        nominal_rays=round(job.rays_factor * pupil_rays.nominal),
        cats_eye=job.aperture.cats_eye,
        lens=pupil_rays.lens,
        seed=job.seed,
        above=job.above,
        viewport=job.picture_viewport,
    )


def _bundle_smooth_tiles(job: RaysJob, pupil_rays: _Rays, result: np.ndarray) -> np.ndarray | None:
    """Write tiles of one smooth surface behind an aberrated lens to ``result``.

    Returns:
        Weight of the rays of each pixel over the tiles, (H, W); None if no bundles are used.
    """
    if pupil_rays.lens is None or pupil_rays.extents is None or pupil_rays.fringes is not None:
        return None
    return render_smooth_tiles(job, pupil_rays.near, pupil_rays.extents, result)


def render_rays(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    device: Device = CPU,
    **options: Unpack[ClassicalOptions],
) -> ClassicalResult:
    """Render with rays and return the complete result; arguments and errors as for :func:`rays`."""
    job = PictureJob(image=image, defocus=defocus, aperture=aperture or Aperture(), device=device, **options)
    return _render(job)
