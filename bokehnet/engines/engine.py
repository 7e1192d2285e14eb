"""Engines: picture and defocus in, bokeh out, without torch."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.arrays.row_blocks import cut_row_blocks, in_row_blocks
from bokehnet.arrays.viewport import Viewport
from bokehnet.baselines.registry import BASELINES, baseline_renderer
from bokehnet.checks import check_choice, check_kind, check_same_size
from bokehnet.classical.base import MAX_RADIUS_IN_SIDES, ClassicalResult, Strip, check_inputs
from bokehnet.classical.known_surfaces import KnownSurfaces, concatenate_surfaces
from bokehnet.engine_registry import ENGINES
from bokehnet.engines.coarse_to_fine import (
    ARNET_BYTES,
    MAX_NETWORK_PIXELS,
    MIN_NETWORK_PIXELS,
    CoarseInput,
    correct_level_by_level,
)
from bokehnet.engines.devices import device_of, make_on, providers_on
from bokehnet.engines.expected_error import ERROR_BYTES, ErrorEstimate, check_expected_error
from bokehnet.engines.job import EngineResult, Job, Lens, NetworkInputs
from bokehnet.engines.options import RenderOptions, with_option_keywords
from bokehnet.engines.strips import StripAccumulator, cut, working_memory
from bokehnet.errors import ParameterError
from bokehnet.inference.session import WEIGHTS, load_networks
from bokehnet.onnx_session import CPU
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER
from bokehnet.optics.tone import gamma_curve
from bokehnet.progress import Progress, ignore_progress

__all__ = ["Engine", "EngineResult", "ray_reach"]

# Progress steps per strip, and for the networks.
_STEPS = 100


def _max_coc_radius(defocus: np.ndarray, known: KnownSurfaces | None = None) -> float:
    """Return the largest blur radius, pixels."""
    radius = max(0.0, float(defocus.max()), -float(defocus.min()))  # 0 first, to avoid -0.0
    if known is None or not len(known.rows):
        return radius
    return max(radius, float(known.near.max()), -float(known.far.min()))


def _within_radius_limit(defocus: np.ndarray, options: RenderOptions) -> tuple[np.ndarray, RenderOptions]:
    """Return defocus and options with blur radii of at most ``MAX_RADIUS_IN_SIDES`` longer sides."""
    limit = MAX_RADIUS_IN_SIDES * max(defocus.shape)
    if _max_coc_radius(defocus, options.known) <= limit:
        return defocus, options
    if options.known is not None:
        options = replace(options, known=options.known.with_radius_limit(limit))
    return np.clip(defocus, -limit, limit), options


def ray_reach(lens_response: LensResponse, viewport: Viewport, max_coc_radius: int) -> int:
    """Return the maximum distance of a pixel's rays from it, pixels.

    Args:
        lens_response: Response of the lens.
        viewport: Position of the pixels in the shown picture.
        max_coc_radius: Largest blur radius, pixels.
    """
    if lens_response.is_ideal:
        return max_coc_radius
    from bokehnet.classical.layered.march.aberrated_rays import lens_table

    chances = (np.arange(8)[:, None] + np.full(3, 0.5)) / 8  # the reach does not depend on the rays
    return lens_table(lens_response, viewport, chances).reach(max_coc_radius)


def _prepare_light(image: np.ndarray, defocus: np.ndarray, options: RenderOptions) -> tuple[np.ndarray, Lens]:
    """Return the image and the lens, with light at least 0 and clipped light restored."""
    known, layers, highlights = options.known, options.layers, options.highlights
    known = known and known.with_mapped_colors(lambda light: np.maximum(light, 0))
    layers = layers and layers.with_mapped_colors(lambda light: np.maximum(light, 0))
    output = image if options.overwrite and image.flags.writeable else None
    if image.min() < 0:
        image = np.maximum(image, 0, out=output)
    if highlights is not None:
        image = in_row_blocks(highlights.expand, image, out=output)
        known = known and known.with_mapped_colors(highlights.expand)
        layers = layers and layers.with_mapped_colors(highlights.expand)
    return image, Lens(
        aperture=options.aperture or Aperture(),
        lens_response=options.lens_response or LensResponse(),
        viewport=options.viewport or Viewport.whole(*defocus.shape),
        pixel_filter=options.pixel_filter or DEFAULT_FILTER,
        known=known,
        rays_factor=options.rays_factor,
        layers=layers,
    )


def _max_pixels(memory: int | None, bytes_per_pixel: int) -> int:
    """Return the maximum number of pixels per network call."""
    max_pixels = MAX_NETWORK_PIXELS if memory is None else memory // bytes_per_pixel
    return max(MIN_NETWORK_PIXELS, min(MAX_NETWORK_PIXELS, max_pixels))


class Engine:
    """Renderer on the CPU, or a CUDA device. Several threads may use one engine at the same time.

    Args:
        name: One of ``ENGINES``, or of ``BASELINES``, methods of the literature.
        weights: Folder with the networks and their manifest; default: the package's own.
        threads: Threads inside a network; 0 uses all cores.
        providers: Execution providers of ONNX Runtime, in order of preference.
        session_options: An ``onnxruntime.SessionOptions`` that replaces the default; ``threads`` is then
            ignored.
        device: ``cpu``, ``cuda``, or ``auto``: CUDA if it is usable. On a device the classical half runs
            there, and so do the networks if ONNX Runtime supports it; with ``auto`` an aberrated lens is
            rendered on the CPU.

    Attributes:
        name: See above.
        classical_name: Name of its classical renderer.
        device: ``cpu`` or ``cuda``.

    Raises:
        ParameterError: Unknown engine, or a provider that ONNX Runtime does not support here.
        ModelFileError: The engine needs networks, and they are missing, damaged, or those of another engine.
    """

    def __init__(
        self,
        name: str = "rays",
        *,
        weights: Path | None = None,
        threads: int = 0,
        providers: Sequence[str] = ("CPUExecutionProvider",),
        session_options: Any = None,
        device: str = "cpu",
    ) -> None:
        if name not in BASELINES:
            check_choice("engine", name, ENGINES)
        self.name, self._threads = name, threads
        spec = ENGINES.get(name)
        self.classical_name = spec.classical if spec else name
        requested_device, self.device = device, device_of(device, self.classical_name)
        if self.device != "cpu" and tuple(providers) == CPU:
            providers = providers_on(self.device)
        self._networks = (
            load_networks(
                weights or WEIGHTS / spec.networks,
                spec.classical,
                threads,
                providers,
                session_options,
                refine=spec.refines,
            )
            if spec and spec.networks
            else None
        )
        baseline = name in BASELINES
        self._classical = baseline_renderer(name) if baseline else make_on(self.device, self.classical_name)
        self._lens_fallback = (
            make_on("cpu", self.classical_name) if requested_device == "auto" and not baseline else None
        )

    def render(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        progress: Progress | None = None,
        options: RenderOptions | None = None,
        **deprecated: Any,
    ) -> EngineResult:
        """Render one picture from its defocus.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3). Values below 0 count as 0.
            defocus: Signed blur radius in pixels, (H, W), positive in front of focus.
            progress: Callback that receives (completed steps, total steps); an exception in it ends the
                render.
            options: Aperture, lens, tone, known surfaces and memory; default: those of
                :class:`RenderOptions`.
            deprecated: Fields of the options as keywords; version 0.3 removes them.

        Raises:
            ShapeError: The arrays are not (H, W, 3) and (H, W) of the same size.
            ParameterError: NaN or infinity in defocus or image; known pixels outside; gamma out of range, or
                not 1 with a hybrid; ``max_memory`` too small, or with networks that cannot work in strips;
                ``expected_error`` without rays, or behind an aberrated lens.
            ModelFileError: ``expected_error`` needs a network that is missing or damaged.
        """
        check_kind("options", options, RenderOptions, optional=True)
        options = with_option_keywords(options, deprecated) or RenderOptions()
        image, defocus = (x.astype(np.float32, copy=False) for x in check_inputs(image, defocus))
        self._check_options(options, image, defocus)
        defocus, options = _within_radius_limit(defocus, options)
        image, lens = _prepare_light(image, defocus, options)
        memory_in_use = options.memory_in_use
        if options.overwrite and defocus.flags.writeable and self._reads_defocus_again:
            memory_in_use += defocus.nbytes  # the error map cannot replace it
        strips = self._cut(defocus, lens, options.max_memory, memory_in_use, options.expected_error)
        largest = _max_coc_radius(defocus, lens.known)  # before defocus is overwritten
        available = None if options.max_memory is None else options.max_memory - memory_in_use
        network_inputs = self._make_network_inputs(defocus.shape, largest, available, options.expected_error)
        job = Job(
            image=image,
            defocus=defocus,
            lens=lens,
            curve=None if options.gamma == 1 else gamma_curve(image, options.gamma),
            report=progress or ignore_progress,
            network_inputs=network_inputs,
        )
        result = self._render_strips(job, strips, options.overwrite) if strips else self._render_whole(job)
        estimate = network_inputs.estimate
        error_estimate = None if estimate is None else estimate.estimate()
        return replace(result, largest_blur=largest, expected_error=error_estimate)

    def _check_options(self, options: RenderOptions, image: np.ndarray, defocus: np.ndarray) -> None:
        """Raise ``ParameterError`` unless the options fit the engine and the picture."""
        if options.known is not None:
            options.known.check_within(*defocus.shape)
        if options.layers is not None:
            check_same_size("image", image, "layers", options.layers.defocus[..., 0])
        if self._networks is not None and options.gamma != 1:
            raise ParameterError(
                "gamma",
                f"1, as in the training of the networks of {self.name}",
                options.gamma,
                f"use the engine `{self.classical_name}`",
            )
        if options.expected_error:
            lens_response = options.lens_response or LensResponse()
            check_expected_error(self.classical_name, lens_response, options.gamma, self.name)

    def _make_network_inputs(
        self, shape: tuple[int, ...], largest: float, available: int | None, expected_error: bool
    ) -> NetworkInputs:
        """Return empty inputs of the networks for a picture (H, W) with blur radii up to ``largest`` pixels.

        ``available`` bytes bound the pixels per call of a network; None: no bound.
        """
        (height, width), coarse, estimate = shape, None, None
        if self._networks is not None and self._networks.iunet is None:
            max_pixels = _max_pixels(available, ARNET_BYTES)
            coarse = CoarseInput(height, width, largest, self._networks.network_max_radius, max_pixels)
        if expected_error:
            max_pixels = _max_pixels(available, ERROR_BYTES)
            estimate = ErrorEstimate(height, width, largest, max_pixels, self._threads)
        return NetworkInputs(coarse, estimate)

    @property
    def _reads_defocus_again(self) -> bool:
        """True if the networks read the defocus after the classical half."""
        return self._networks is not None and self._networks.leaves_outlines

    def _cut(
        self,
        defocus: np.ndarray,
        lens: Lens,
        memory: int | None,
        memory_in_use: int,
        expected_error: bool,
    ) -> list[list[Strip]]:
        """Return strips in bands within ``memory - memory_in_use`` bytes; none for the whole picture."""
        if self.name in BASELINES:
            if memory is not None:
                raise ParameterError(
                    "max_memory", f"None, because {self.name} needs the whole picture", memory
                )
            return []
        is_indivisible = lens.aperture.cats_eye > 0 or (
            self._networks is not None and self._networks.iunet is not None
        )
        max_coc_radius = math.ceil(_max_coc_radius(defocus, lens.known))
        max_ray_reach = None
        if self.classical_name == "rays":  # raises for an impossible tilt
            max_ray_reach = ray_reach(lens.lens_response, lens.viewport, max_coc_radius)
        if memory is None and is_indivisible:
            return []
        if memory is None:
            reach = max(max_coc_radius, max_ray_reach or 0)
            memory, memory_in_use = working_memory(defocus.shape, reach, self.classical_name), 0
            if memory is None:
                return []
        strips = [
            *cut(
                defocus.shape,
                max_coc_radius,
                self.classical_name,
                memory,
                memory_in_use,
                max_ray_reach,
                bands=self._networks is None and not expected_error and lens.layers is None,
            )
        ]
        if len(strips) == len(strips[0]) == 1:
            return []
        if self._networks is not None and self._networks.iunet is not None:
            expected = "None, because these networks need the whole picture at once"
            raise ParameterError("max_memory", expected, memory, "leave it out")
        return strips

    def _render_whole(self, job: Job) -> EngineResult:
        image, defocus, report = job.image, job.defocus, job.report
        steps = _STEPS if self._networks is None else 2 * _STEPS
        report(0, steps)
        classical = self._render_classical(
            job, progress=lambda fraction: report(int(fraction * _STEPS), steps)
        )
        report(_STEPS, steps)
        job.network_inputs.add(0, image, defocus, classical)
        classical = replace(classical, scatter=None)
        if self._networks is None:
            bokeh, classical_error_map = classical.bokeh, classical.error_map
            return EngineResult(
                bokeh=bokeh,
                classical=bokeh,
                neural=None,
                error_map=classical_error_map,
                mixed_pixels=classical.mixed_pixels,
            )
        if job.network_inputs.coarse is None:
            corrected = correct_level_by_level(self._networks, image, defocus, classical)
        else:
            correction = job.network_inputs.coarse.correct(self._networks)
            corrected = correction.apply(classical.bokeh, classical.error_map, defocus)
        report(2 * _STEPS, steps)
        return EngineResult(
            bokeh=corrected.bokeh,
            classical=classical.bokeh,
            neural=corrected.neural,
            error_map=corrected.error_map,
            mixed_pixels=classical.mixed_pixels,
        )

    def _render_strips(self, job: Job, strips: Sequence[Sequence[Strip]], overwrite: bool) -> EngineResult:
        """Render strip by strip, each in bands; then, with a network, correct strip by strip."""
        image, defocus, report, network_inputs = job.image, job.defocus, job.report, job.network_inputs
        networks = self._networks
        results = [
            StripAccumulator(image, overwrite),
            StripAccumulator(defocus, overwrite and not self._reads_defocus_again),
        ]
        bokeh, error_map = (result.array for result in results)
        height, mixed = len(defocus), []
        steps = _STEPS * (len(strips) + (networks is not None))
        for index, bands in enumerate(strips):

            def report_strip(fraction: float, index: int = index) -> None:
                report(int(_STEPS * (index + fraction)), steps)

            report_strip(0.0)
            output = self._render_bands(job, bands, report_strip)
            first = bands[0].first + bands[0].output_rows.start
            inner = slice(first, first + len(output.bokeh))
            if output.mixed_pixels is not None:
                mixed.append(output.mixed_pixels.below(first))
            network_inputs.add(first, image[inner], defocus[inner], output)
            next_first = height if index + 1 == len(strips) else strips[index + 1][0].first
            for result, array in zip(results, (output.bokeh, output.error_map), strict=True):
                result.add(first, array, next_first)
            del output, array  # frees their memory for the next strip
        if networks is not None and network_inputs.coarse is not None:
            report(_STEPS * len(strips), steps)
            correction = network_inputs.coarse.correct(networks)
            for rows in cut_row_blocks(bokeh.shape):
                corrected = correction.apply(bokeh[rows], error_map[rows], defocus[rows], rows.start)
                bokeh[rows], error_map[rows] = corrected.bokeh, corrected.error_map
        report(steps, steps)
        classical = bokeh if networks is None else None
        return EngineResult(
            bokeh=bokeh,
            classical=classical,
            neural=None,
            error_map=error_map,
            mixed_pixels=concatenate_surfaces(mixed),
        )

    def _render_bands(
        self, job: Job, bands: Sequence[Strip], progress: Callable[[float], None]
    ) -> ClassicalResult:
        """Render a strip band by band, without networks."""
        if len(bands) == 1:
            return self._render_classical(job, bands[0], progress)
        rows, width = bands[0].output_rows, job.defocus.shape[1]
        shape = (rows.stop - rows.start, width)
        bokeh, error_map = np.empty((*shape, 3), np.float32), np.empty(shape, np.float32)
        mixed = []
        for index, band in enumerate(bands):

            def report(fraction: float, index: int = index) -> None:
                progress((index + fraction) / len(bands))

            result = self._render_classical(job, band, report)
            left = band.left + band.output_columns.start
            columns = slice(left, left + result.error_map.shape[1])
            bokeh[:, columns], error_map[:, columns] = result.bokeh, result.error_map
            if result.mixed_pixels is not None:
                mixed.append(result.mixed_pixels.in_columns(0, width, left))
            del result
        return ClassicalResult(bokeh=bokeh, error_map=error_map, mixed_pixels=concatenate_surfaces(mixed))

    def _render_classical(
        self,
        job: Job,
        strip: Strip | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> ClassicalResult:
        """Render a strip, or the whole picture, without networks."""
        image, defocus, lens, curve = job.image, job.defocus, job.lens, job.curve
        known, layers = lens.known, lens.layers
        if strip is not None:
            rows, columns = strip.arrays
            image, defocus = (np.ascontiguousarray(array[rows, columns]) for array in (image, defocus))
            known = known and known.part(rows, columns)
            layers = layers and layers.part(rows, columns)
        renderer = self._classical
        if self._lens_fallback is not None and not lens.lens_response.is_ideal:
            renderer = self._lens_fallback
        render = partial(
            renderer,
            strip=strip,
            lens_response=lens.lens_response,
            viewport=lens.viewport,
            progress=progress,
            pixel_filter=lens.pixel_filter,
            rays_factor=lens.rays_factor,
        )
        if curve is None:
            return render(image, defocus, lens.aperture, known=known, layers=layers)
        encoded = known and known.with_mapped_colors(curve.encode)
        bright = layers and layers.with_mapped_colors(curve.encode)
        result = render(curve.encode(image), defocus, lens.aperture, known=encoded, layers=bright)
        mixed = result.mixed_pixels
        return replace(
            result,
            bokeh=curve.decode(result.bokeh),
            mixed_pixels=mixed and mixed.with_mapped_colors(curve.decode),
        )
