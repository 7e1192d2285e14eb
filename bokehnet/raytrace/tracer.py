"""Progressive ray tracer of worlds: its state after any number of samples can be stored and continued."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from bokehnet.checks import check_at_least, check_choice
from bokehnet.errors import ParameterError
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color
from bokehnet.progress import Progress
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.distribution import Distribution, LensSamples
from bokehnet.raytrace.geometry.space import SpaceRays
from bokehnet.raytrace.geometry.tables import pick
from bokehnet.raytrace.paths import trace_paths
from bokehnet.raytrace.world import World

__all__ = ["METHODS", "Accumulation", "Maps", "Tracer", "lens_rays"]

# Maximum number of rays per block: few enough for a CPU cache, enough to occupy a GPU.
_MAX_RAYS_CPU, _MAX_RAYS_GPU = 1 << 15, 1 << 21


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Accumulation:
    """Means over all samples so far.

    Attributes:
        bokeh: Scene-linear picture through the whole pupil, (H, W, 3).
        all_in_focus: Scene-linear picture through the pupil centre, (H, W, 3).
        coverage: Fraction of the pixel's light cone that meets a body, (H, W).
        samples: Mean number of samples per pixel.
        counts: Number of samples of each pixel, (H, W) int64; None if it is the same for all.
        variance: Variance of one sample of each pixel, see :mod:`bokehnet.raytrace.adaptive`, (H, W); None if
            unknown.
    """

    bokeh: Tensor
    all_in_focus: Tensor
    coverage: Tensor
    samples: int
    counts: Tensor | None = None
    variance: Tensor | None = None

    def stacked(self) -> Tensor:
        """Return all means, (H, W, 7)."""
        return torch.cat([self.bokeh, self.all_in_focus, self.coverage[..., None]], -1)

    @classmethod
    def from_stacked(
        cls, means: Tensor, samples: int, counts: Tensor | None = None, variance: Tensor | None = None
    ) -> "Accumulation":
        """Return the state of stacked means; the inverse of :meth:`stacked`."""
        return cls(
            bokeh=means[..., :3],
            all_in_focus=means[..., 3:6],
            coverage=means[..., 6],
            samples=samples,
            counts=counts,
            variance=variance,
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Maps:
    """First surface with alpha >= 0.5 at each pixel centre, through the pupil centre.

    Attributes:
        depth: Depth, mm, (H, W); without a surface infinite, or the depth of the backdrop.
        normal: Unit normal towards the camera, (H, W, 3); 0 without a surface.
        body: Index of the body, (H, W) int64; -1 without a surface.
    """

    depth: Tensor
    normal: Tensor
    body: Tensor

    @property
    def disparity(self) -> Tensor:
        """Inverse depth, 1/mm, (H, W)."""
        return 1 / self.depth


METHODS = ("distribution", "accumulation")


class Tracer:
    """Distribution ray tracer after Cook, or multi-view accumulation.

    Each sample of a pixel has its own position in the pixel, in the pupil, in time, in the spectrum, on the
    lights and in the lobes of the surfaces. With ``accumulation`` all pixels of a sample share the first
    four: each sample is a pinhole picture from one pupil point at one time, so that too few samples show
    ghosts instead of noise.

    Args:
        world: The scene.
        camera: Lens and sensor.
        seed: Seed of the sample positions.
        bounces: Maximum number of scattering events; 1 is direct light.
        shutter: Exposure time, s.
        dispersion: Give each ray a single wavelength, for lenses with dispersion.
        device: Device that traces the rays.
        method: One of ``METHODS``.
        antialiased: Distribute samples over the pixel's area; otherwise all pass its centre.
        rows: First row and end row to trace; the result has only these rows, equal to those of the whole
            picture.

    Raises:
        ParameterError: A number is negative, the method is unknown, or the rows are outside the picture.

    Source:
        Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984; Haeberli and Akeley, "The
        accumulation buffer: hardware support for high-quality rendering", SIGGRAPH 1990; for the spectrum
        Jeong et al., "Expressive chromatic accumulation buffering for defocus blur", The Visual Computer
        2016.
    """

    def __init__(
        self,
        world: World,
        camera: Camera,
        *,
        seed: int = 0,
        bounces: int = 2,
        shutter: float = 0.0,
        dispersion: bool = False,
        device: torch.device | str = "cpu",
        method: str = "distribution",
        antialiased: bool = True,
        rows: tuple[int, int] | None = None,
    ) -> None:
        check_at_least("bounces", bounces, 0)
        check_at_least("shutter", shutter, 0)
        check_choice("method", method, METHODS)
        first, stop = rows or (0, camera.height)
        if not 0 <= first < stop <= camera.height:
            raise ParameterError("rows", f"two rising numbers from 0 to {camera.height}", rows)
        self.world, self.camera = world, camera
        self._bounces, self._shutter, self._dispersion = bounces, shutter, dispersion
        self._device, self._antialiased = torch.device(device), antialiased
        self._size = (stop - first, camera.width)
        self._pixels = self._size[0] * camera.width
        self._sensor = camera.sensor_xy(self._device, torch.float32)[first:stop].reshape(-1, 2)
        self._distribution = Distribution(
            camera.width * camera.height,
            bounces,
            seed,
            self._device,
            window=slice(first * camera.width, stop * camera.width),
            shared_views=method == "accumulation",
        )
        self._max_rays = _MAX_RAYS_CPU if self._device.type == "cpu" else _MAX_RAYS_GPU

    def begin(self) -> Accumulation:
        """Return the state before the first sample."""
        size = self._size
        black = torch.zeros(*size, 3, device=self._device)
        return Accumulation(
            bokeh=black, all_in_focus=black, coverage=torch.zeros(size, device=self._device), samples=0
        )

    @torch.no_grad()
    def advance(self, state: Accumulation, samples: int) -> Accumulation:
        """Return ``state`` with more samples, at most ``samples`` in total.

        Steps end at fixed counts, so that a picture does not depend on where it was interrupted.
        """
        block = max(1, self._max_rays // self._pixels)
        stop = min(samples, (state.samples // block + 1) * block)
        means = state.stacked().reshape(self._pixels, 7).clone()
        all_pixels = torch.arange(self._pixels, device=self._device)
        for pixels, samples_of_pixels in self.trace(all_pixels, state.samples, stop - state.samples):
            for offset, values in enumerate(samples_of_pixels):
                means[pixels] += (values - means[pixels]) / (state.samples + offset + 1)
        return Accumulation.from_stacked(means.reshape(*self._size, 7), stop)

    @torch.no_grad()
    def trace(self, pixels: Tensor, start: int, count: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Trace ``count`` samples of ``pixels`` (P,), from sample ``start``.

        Yields:
            A block of the pixels, (Q,), and bokeh, all-in-focus and coverage of their samples, (count, Q, 7).
        """
        points = self._distribution.points(start, count)
        for part in pixels.split(self._max_rays):
            yield part, self._trace(points, part)

    @torch.no_grad()
    def trace_bokeh(self, start: int, count: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Trace ``count`` samples of all pixels through the whole pupil only, from sample ``start``.

        Yields:
            A block of the pixels, (Q,), and the sum of the colours of their samples, (Q, 3).
        """
        points = self._distribution.points(start, count)
        for part in torch.arange(self._pixels, device=self._device).split(self._max_rays):
            samples = self._distribution.lens_samples(points, part)
            color, _ = self._trace_samples(points, part, samples, self._dispersion)
            yield part, color.reshape(count, -1, 3).sum(0)

    def render(self, samples: int, progress: Progress | None = None) -> Accumulation:
        """Return the means of ``samples`` samples; calls ``progress`` with the number done."""
        check_at_least("samples", samples, 1)
        state = self.begin()
        while state.samples < samples:
            state = self.advance(state, samples)
            if progress is not None:
                progress(state.samples, samples)
        return state

    def _trace(self, points: Tensor, pixels: Tensor) -> Tensor:
        """Return bokeh, all-in-focus and coverage, (S, P, 7), of ``points`` (S, D) for P pixels."""
        samples = self._distribution.lens_samples(points, pixels)
        sharp = LensSamples(
            pupil_uv=torch.zeros_like(samples.pupil_uv),
            jitter=samples.jitter,
            time=samples.time,
            wavelength=samples.wavelength,
        )
        color, coverage = self._trace_samples(points, pixels, samples, self._dispersion)
        pinhole = self._trace_samples(points, pixels, sharp, False)[0]
        return torch.cat([color, pinhole, coverage[:, None]], -1).reshape(len(points), -1, 7)

    def _trace_samples(
        self, points: Tensor, pixels: Tensor, samples: LensSamples, dispersion: bool
    ) -> tuple[Tensor, Tensor]:
        """Return colour (M, 3) and coverage (M,) of samples, weighted by the transmittance of the lens."""
        sensor = self._sensor[pixels].repeat(len(points), 1)
        if self._antialiased:
            sensor = sensor + self.camera.pixel_pitch * samples.jitter
        wavelength = (
            MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * samples.wavelength if dispersion else None
        )
        rays, weight = lens_rays(
            self.camera, sensor, samples.pupil_uv, samples.time * self._shutter, wavelength
        )
        color, coverage = torch.zeros_like(rays.origin), torch.zeros_like(weight)
        alive = (weight > 0).nonzero()[:, 0]

        def numbers(dimension: Tensor, row: Tensor) -> Tensor:
            return self._distribution.path_number(points, pixels, dimension, alive[row])

        traced = trace_paths(self.world, pick(rays, alive), numbers, self._bounces)
        color[alive] = traced.color * weight[alive, None]
        coverage[alive] = traced.coverage
        if wavelength is not None:
            color *= wavelength_color(wavelength)
        return color, coverage

    @torch.no_grad()
    def maps(self) -> Maps:
        """Return the geometry maps at mid-exposure."""
        mid_exposure = torch.zeros_like(self._sensor[:, 0])
        rays, _ = lens_rays(self.camera, self._sensor, torch.zeros_like(self._sensor), mid_exposure)
        size = self._size
        backdrop = self.world.backdrop
        background_depth = (
            torch.inf if backdrop is None or backdrop.disparity == 0 else 1 / backdrop.disparity
        )
        solid = self.world.first_solid(rays)
        depth = torch.where(solid.body >= 0, solid.hits.distance, background_depth)
        normal, body = solid.normal, solid.body
        return Maps(depth=depth.reshape(size), normal=normal.reshape(*size, 3), body=body.reshape(size))


def lens_rays(
    camera: Camera, sensor_xy: Tensor, pupil_uv: Tensor, time: Tensor, wavelength: Tensor | None = None
) -> tuple[SpaceRays, Tensor]:
    """Return rays from sensor points (M, 2), mm, into the world, and their weights from the lens, (M,)."""
    rays = camera.lens.sample_rays(sensor_xy, pupil_uv, wavelength)
    weight = torch.ones_like(time) if rays.weight is None else rays.weight
    zero, one = torch.zeros_like(time)[:, None], torch.ones_like(time)[:, None]
    origin = torch.cat([rays.origin, zero], -1)
    direction = torch.cat([rays.slope, one], -1)
    if camera.pose is not None:  # distances along the rays remain depths
        rotation = origin.new_tensor(camera.pose.rotation).T
        origin = origin @ rotation + origin.new_tensor(camera.pose.position)
        direction = direction @ rotation
    return SpaceRays(origin=origin, direction=direction, time=time), weight
