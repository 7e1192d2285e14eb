"""Pictures of a world, sample by sample: what is there after some samples can be kept and carried on."""

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

# Rays that are followed at once: few enough for a processor's cache, enough to keep a GPU busy.
_RAYS_ON_CPU, _RAYS_ON_GPU = 1 << 15, 1 << 21


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Accumulation:
    """Means over the samples so far.

    Attributes:
        bokeh: Scene-linear picture through the whole pupil, (H, W, 3).
        all_in_focus: The same through the middle of the pupil, (H, W, 3).
        coverage: Share of the pixel's light cone that meets a body, (H, W).
        samples: How many there are of each pixel, in the mean.
        counts: How many of each, (H, W) int64; None for as many of all.
        variance: Of one sample of each pixel, see :mod:`bokehnet.raytrace.adaptive`, (H, W); None if that is
            not known.
    """

    bokeh: Tensor
    all_in_focus: Tensor
    coverage: Tensor
    samples: int
    counts: Tensor | None = None
    variance: Tensor | None = None

    def stacked(self) -> Tensor:
        """All means, (H, W, 7)."""
        return torch.cat([self.bokeh, self.all_in_focus, self.coverage[..., None]], -1)

    @classmethod
    def from_stacked(
        cls, means: Tensor, samples: int, counts: Tensor | None = None, variance: Tensor | None = None
    ) -> "Accumulation":
        """The inverse of :meth:`stacked`."""
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
    """The first surface with alpha >= 0.5 at each pixel's centre, through the middle of the pupil.

    Attributes:
        depth: mm, (H, W); infinite where there is nothing, or the depth of the backdrop.
        normal: Of length 1, towards the camera, (H, W, 3); 0 where there is nothing.
        body: Index of the body, (H, W) int64; -1 where there is nothing.
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
    """Cook's distribution ray tracer, or multi-view accumulation.

    Each sample of a pixel has its own place in the pixel, in the pupil, in time, in the spectrum, on the
    lights and in the lobes of the surfaces that it meets. With ``accumulation`` all pixels of a sample share
    the first four: each sample is a whole picture, taken from one point of the pupil at one moment, so that
    few of them show as so many ghosts instead of noise.

    Args:
        world: The scene.
        camera: Lens and sensor.
        seed: Same seed, same picture.
        bounces: How often light may be scattered on its way; 1 is direct light.
        shutter: How long the shutter is open, s.
        dispersion: Let each ray have one wavelength, for lenses that part them.
        device: Where the rays are followed.
        method: One of ``METHODS``.
        antialiased: Send samples through all of a pixel; else through its centre.
        rows: Rows of the picture that are traced; what comes out has these alone, and is as it would be in
            the whole picture.

    Raises:
        ParameterError: A number is negative, another method, or rows that the picture does not have.

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
        self._most = _RAYS_ON_CPU if self._device.type == "cpu" else _RAYS_ON_GPU

    def begin(self) -> Accumulation:
        """No samples yet."""
        size = self._size
        black = torch.zeros(*size, 3, device=self._device)
        return Accumulation(
            bokeh=black, all_in_focus=black, coverage=torch.zeros(size, device=self._device), samples=0
        )

    @torch.no_grad()
    def advance(self, so_far: Accumulation, samples: int) -> Accumulation:
        """Return ``so_far`` with some more samples, at most ``samples`` in all.

        Steps end at fixed counts, so that a picture does not depend on where it was broken off.
        """
        block = max(1, self._most // self._pixels)
        stop = min(samples, (so_far.samples // block + 1) * block)
        means = so_far.stacked().reshape(self._pixels, 7).clone()
        everywhere = torch.arange(self._pixels, device=self._device)
        for pixels, seen in self.trace(everywhere, so_far.samples, stop - so_far.samples):
            for offset, values in enumerate(seen):
                means[pixels] += (values - means[pixels]) / (so_far.samples + offset + 1)
        return Accumulation.from_stacked(means.reshape(*self._size, 7), stop)

    @torch.no_grad()
    def trace(self, pixels: Tensor, start: int, count: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Trace ``count`` samples of ``pixels`` (P,) from their sample ``start`` on.

        Yields:
            Some of the pixels, (Q,), and bokeh, all-in-focus and coverage of their samples, (count, Q, 7).
        """
        points = self._distribution.points(start, count)
        for part in pixels.split(self._most):
            yield part, self._trace(points, part)

    def render(self, samples: int, progress: Progress | None = None) -> Accumulation:
        """Return the means of ``samples`` samples; ``progress`` is told how many are done."""
        check_at_least("samples", samples, 1)
        state = self.begin()
        while state.samples < samples:
            state = self.advance(state, samples)
            if progress is not None:
                progress(state.samples, samples)
        return state

    def _trace(self, points: Tensor, pixels: Tensor) -> Tensor:
        """Bokeh, all-in-focus and coverage, (S, P, 7), of ``points`` (S, D) for P pixels."""
        samples = self._distribution.lens_samples(points, pixels)
        sharp = LensSamples(
            pupil_uv=torch.zeros_like(samples.pupil_uv),
            jitter=samples.jitter,
            time=samples.time,
            wavelength=samples.wavelength,
        )
        color, coverage = self._see(points, pixels, samples, self._dispersion)
        pinhole = self._see(points, pixels, sharp, False)[0]
        return torch.cat([color, pinhole, coverage[:, None]], -1).reshape(len(points), -1, 7)

    def _see(
        self, points: Tensor, pixels: Tensor, samples: LensSamples, dispersion: bool
    ) -> tuple[Tensor, Tensor]:
        """Colour (M, 3) and coverage (M,) of samples, weighted by what the lens lets through."""
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
        """Geometry at the middle of the shutter's opening."""
        still = torch.zeros_like(self._sensor[:, 0])
        rays, _ = lens_rays(self.camera, self._sensor, torch.zeros_like(self._sensor), still)
        size = self._size
        backdrop = self.world.backdrop
        nothing = torch.inf if backdrop is None or backdrop.disparity == 0 else 1 / backdrop.disparity
        depth = torch.full_like(still, nothing)
        normal = torch.zeros_like(rays.origin)
        body = torch.full_like(still, -1, dtype=torch.int64)
        row = torch.arange(self._pixels, device=self._device)
        beyond, last = torch.zeros_like(still), body.clone()
        while len(row):
            hit = self.world.intersect(pick(rays, row), beyond, last)
            there = hit.body >= 0
            row, hit = row[there], pick(hit, there)
            seen, texture = self.world.surfaces(pick(rays, row), hit)
            solid = texture[:, 3] >= 0.5
            ends = row[solid]
            depth[ends], body[ends] = hit.hits.distance[solid], hit.body[solid]
            towards = (seen * rays.direction[row]).sum(-1, keepdim=True) < 0
            normal[ends] = torch.where(towards, seen, -seen)[solid]
            row, beyond, last = row[~solid], hit.hits.distance[~solid], hit.body[~solid]
        return Maps(depth=depth.reshape(size), normal=normal.reshape(*size, 3), body=body.reshape(size))


def lens_rays(
    camera: Camera, sensor_xy: Tensor, pupil_uv: Tensor, time: Tensor, wavelength: Tensor | None = None
) -> tuple[SpaceRays, Tensor]:
    """Rays from sensor points (M, 2), mm, into the world, and the light that the lens gives each, (M,)."""
    rays = camera.lens.sample_rays(sensor_xy, pupil_uv, wavelength)
    weight = torch.ones_like(time) if rays.weight is None else rays.weight
    zero, one = torch.zeros_like(time)[:, None], torch.ones_like(time)[:, None]
    origin = torch.cat([rays.origin, zero], -1)
    direction = torch.cat([rays.slope, one], -1)
    return SpaceRays(origin=origin, direction=direction, time=time), weight
