"""The engines: picture and defocus in, bokeh out, without torch."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.arrays.row_blocks import cut_row_blocks, in_row_blocks
from bokehnet.baselines.registry import BASELINES, baseline_renderer
from bokehnet.checks import check_choice, check_kind, check_number, check_same_size
from bokehnet.classical.base import (
    ClassicalResult,
    Place,
    Strip,
    check_inputs,
)
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces, joined_surfaces
from bokehnet.engine_registry import ENGINES
from bokehnet.engines.coarse_to_fine import (
    ARNET_BYTES,
    LEAST_PIXELS,
    MOST_PIXELS,
    CoarseInput,
    correct_level_by_level,
)
from bokehnet.engines.devices import device_of, make_on, providers_on
from bokehnet.engines.expected_error import ERROR_BYTES, ErrorEstimate, check_expects_error
from bokehnet.engines.strips import StripAccumulator, cut_strips, working_memory
from bokehnet.errors import ParameterError
from bokehnet.inference.session import WEIGHTS, load_networks
from bokehnet.onnx_session import CPU
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter
from bokehnet.optics.tone import GammaCurve, Highlights, gamma_curve
from bokehnet.progress import Progress, ignore_progress

__all__ = ["Engine", "EngineResult", "ray_reach"]

# Steps of progress in a strip, and in the network's work.
_STEPS = 100


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineResult:
    """A rendered picture and what it was made of; all scene-linear float32.

    Attributes:
        bokeh: The result, (H, W, 3).
        classical: The classical half, (H, W, 3); ``None`` where a hybrid was rendered in strips.
        neural: The neural half, (H, W, 3); ``None`` for a classical engine, and in strips.
        error_map: The blend, (H, W) in [0, 1], 1 = neural: the learned map within the reach of a depth
            discontinuity, 0 elsewhere; for a classical engine, where it can be wrong.
        largest_blur: Largest blur radius, pixels.
        mixed_pixels: Pixels that were rendered as two surfaces, with both; ``None`` for engines that part
            none.
        expected_error: What is expected of the mean over colours of |sRGB value - truth|, 8-bit levels, (H,
            W); ``None`` where it was not asked for.
    """

    bokeh: np.ndarray
    classical: np.ndarray | None
    neural: np.ndarray | None
    error_map: np.ndarray
    largest_blur: float = 0.0
    mixed_pixels: KnownSurfaces | None = None
    expected_error: np.ndarray | None = None


def _max_coc_radius(defocus: np.ndarray, known: KnownSurfaces | None = None) -> float:
    """Largest blur radius, pixels."""
    radius = max(0.0, float(defocus.max()), -float(defocus.min()))  # 0 before zeros that are negative
    if known is None or not len(known.rows):
        return radius
    return max(radius, float(known.near.max()), -float(known.far.min()))


def ray_reach(lens_response: LensResponse, place: Place, max_coc_radius: int) -> int:
    """Pixels within which the rays of a pixel stay, at most.

    Args:
        lens_response: What the lens does beyond focusing.
        place: Where the pixels lie in the shown picture.
        max_coc_radius: Largest blur radius, pixels.
    """
    if lens_response.is_ideal:
        return max_coc_radius
    from bokehnet.classical.layered.march.aberrated_rays import lens_table

    chances = (np.arange(8)[:, None] + np.full(3, 0.5)) / 8  # of what rays there are, the reach is the same
    return lens_table(lens_response, place, chances).reach(max_coc_radius)


@dataclass(frozen=True, slots=True)
class _Lens:
    """What one picture was taken with and is rendered through, and what is known of its edges."""

    aperture: Aperture
    lens_response: LensResponse
    place: Place
    pixel_filter: PixelFilter
    known: KnownSurfaces | None = None
    rays_share: float = 1.0
    layers: Layers | None = None


@dataclass(frozen=True, slots=True)
class _Gathered:
    """What networks see of the whole picture, taken in while it is rendered."""

    coarse: CoarseInput | None
    estimate: ErrorEstimate | None

    def add(self, first: int, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult) -> None:
        """Take in rows, as both do."""
        for seen in (self.coarse, self.estimate):
            if seen is not None:
                seen.add(first, image, defocus, classical)


def _most_pixels(memory: int | None, bytes_per_pixel: int) -> int:
    """Pixels that a network may see at once."""
    left = MOST_PIXELS if memory is None else memory // bytes_per_pixel
    return max(LEAST_PIXELS, min(MOST_PIXELS, left))


class Engine:
    """Renders on the CPU, or a CUDA device. One engine may be used by several threads at once.

    Args:
        name: One of ``ENGINES``, or of ``BASELINES``, methods of the literature.
        weights: Folder with the networks and their manifest; the package's own by default.
        threads: Threads inside a network; 0 takes all cores.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        session_options: An ``onnxruntime.SessionOptions`` to use in place of our own; ``threads`` is then
            left to it.
        device: ``cpu``, ``cuda``, or ``auto``: that where it can be used. On a device the classical half runs
            there, and networks do where ONNX Runtime has it; a lens that does more than focus is followed on
            the CPU.

    Attributes:
        name: The same.
        classical_name: The renderer without networks that it rests on.
        device: ``cpu`` or ``cuda``.

    Raises:
        ParameterError: Unknown engine, or a provider that ONNX Runtime does not have here.
        ModelFileError: The engine needs networks, and they are missing or damaged.
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
        asked, self.device = device, device_of(device, spec.classical if spec else name)
        if self.device != "cpu" and tuple(providers) == CPU:
            providers = providers_on(self.device)
        self._networks = (
            load_networks(
                weights or WEIGHTS / spec.networks, threads, providers, session_options, refine=spec.refines
            )
            if spec and spec.networks
            else None
        )
        self.classical_name = self._networks.classical if self._networks else name
        baseline = name in BASELINES
        self._classical = baseline_renderer(name) if baseline else make_on(self.device, self.classical_name)
        self._behind_glass = make_on("cpu", self.classical_name) if asked == "auto" and not baseline else None

    def render(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        progress: Progress | None = None,
        *,
        aperture: Aperture | None = None,
        lens_response: LensResponse | None = None,
        place: Place | None = None,
        pixel_filter: PixelFilter | None = None,
        gamma: float = 1.0,
        highlights: Highlights | None = None,
        max_memory: int | None = None,
        memory_taken: int = 0,
        overwrite: bool = False,
        known: KnownSurfaces | None = None,
        rays_share: float = 1.0,
        layers: Layers | None = None,
        expected_error: bool = False,
    ) -> EngineResult:
        """Render one picture from its defocus.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3). Values below 0 count as 0.
            defocus: Signed blur radius in pixels, (H, W), positive in front of focus.
            progress: Called with (steps done, steps in all); what it raises ends the rendering.
            aperture: Shape of the lens opening; default a plain disc. Networks were trained on discs; with
                other shapes they correct what the classical half made of them.
            lens_response: What the lens does beyond focusing; default a perfect lens.
            place: Where the pixels lie in the shown picture, from whose middle the lens counts; default: they
                are all of it.
            pixel_filter: Of the picture, by which its pixels at edges mix both sides; default
                Blackman-Harris of 1.5, as of Blender.
            gamma: Above 1 bright pixels prevail where light mixes, 0.2 to 5; 1 is a real lens. See
                :func:`bokehnet.optics.tone.gamma_curve`.
            highlights: How clipped lights get their brightness back before blurring. The result keeps
                it, unclipped; :meth:`Highlights.compress` brings it back to the range of the photograph.
            max_memory: Bytes that rendering may take beyond image, defocus and result. Pictures that need
                more are rendered in strips; the result is the same but for rounding.
            memory_taken: Bytes of ``max_memory`` that are not to be had any more.
            overwrite: Whether the result may take the place of ``image`` and ``defocus``, which are of no
                use afterwards; in strips this saves their memory. Both must be float32, C-contiguous and
                writable, else they are left alone.
            known: Surfaces of pixels at edges that need not be estimated; engines that take pixels as one
                surface each do so still.
            rays_share: Share of the usual rays of a pixel, above 0 to 1, where several pixels will be reduced
                to one.
            layers: True layers, for engines that march rays, in place of those that would be made of the
                picture; the others take the picture as it is.
            expected_error: Whether to tell how far off the rays may be. With a hybrid it is theirs, too.

        Raises:
            ShapeError: Not (H, W, 3) and (H, W) of one size.
            ParameterError: NaN or infinity in defocus or image; known pixels outside; gamma out of range, or
                not 1 with a hybrid; ``max_memory`` too small, or with networks that cannot work in strips;
                ``expected_error`` without rays, or behind a lens that does more than focus.
            ModelFileError: ``expected_error`` needs a network that is missing or damaged.
        """
        check_kind("aperture", aperture, Aperture, optional=True)
        check_kind("lens_response", lens_response, LensResponse, optional=True)
        check_kind("known", known, KnownSurfaces, optional=True)
        check_kind("layers", layers, Layers, optional=True)
        image, defocus = (x.astype(np.float32, copy=False) for x in check_inputs(image, defocus))
        check_kind("pixel_filter", pixel_filter, PixelFilter, optional=True)
        place = place or Place.whole(*defocus.shape)
        if known is not None:
            known.check_within(*defocus.shape)
            known = known.with_mapped_colors(lambda light: np.maximum(light, 0))
        if layers is not None:
            check_same_size("image", image, "layers", layers.defocus[..., 0])
            layers = layers.with_mapped_colors(lambda light: np.maximum(light, 0))
        over = image if overwrite and image.flags.writeable else None
        if image.min() < 0:
            image = np.maximum(image, 0, out=over)
        if self._networks is not None and gamma != 1:
            raise ParameterError(
                "gamma",
                f"1, all that the networks of {self.name} know",
                gamma,
                f"use the engine `{self.classical_name}`",
            )
        check_kind("highlights", highlights, Highlights, optional=True)
        if highlights is not None:
            image = in_row_blocks(highlights.expand, image, out=over)
            known = known and known.with_mapped_colors(highlights.expand)
            layers = layers and layers.with_mapped_colors(highlights.expand)
        curve = None if gamma == 1 else gamma_curve(image, gamma)
        if max_memory is not None:
            check_number("max_memory", max_memory)
        lens = _Lens(
            aperture=aperture or Aperture(),
            lens_response=lens_response or LensResponse(),
            place=place,
            pixel_filter=pixel_filter or DEFAULT_FILTER,
            known=known,
            rays_share=rays_share,
            layers=layers,
        )
        if expected_error:
            check_expects_error(self.classical_name, lens.lens_response, gamma, self.name)
        if overwrite and defocus.flags.writeable and self._reads_defocus_again:
            memory_taken += defocus.nbytes  # of the error map, which cannot take its place
        strips = self._cut(defocus, lens, max_memory, memory_taken)
        report, largest = (
            progress or ignore_progress,
            _max_coc_radius(defocus, known),
        )  # before it may be written over
        left = None if max_memory is None else max_memory - memory_taken
        (height, width), coarse, estimate = defocus.shape, None, None
        if self._networks is not None and self._networks.iunet is None:
            most = _most_pixels(left, ARNET_BYTES)
            coarse = CoarseInput(height, width, largest, self._networks.network_max_radius, most)
        if expected_error:
            most = _most_pixels(left, ERROR_BYTES)
            estimate = ErrorEstimate(height, width, largest, most, self._threads)
        gathered = _Gathered(coarse, estimate)
        if len(strips) > 1:
            result = self._render_strips(image, defocus, lens, curve, strips, report, overwrite, gathered)
        else:
            result = self._render_whole(image, defocus, lens, curve, report, gathered)
        told = None if estimate is None else estimate.tell()
        return replace(result, largest_blur=largest, expected_error=told)

    @property
    def _reads_defocus_again(self) -> bool:
        """Whether networks want it once the classical half is there."""
        return self._networks is not None and self._networks.leaves_outlines

    def _cut(self, defocus: np.ndarray, lens: _Lens, memory: int | None, taken: int) -> list[Strip | None]:
        """Strips of at most ``memory - taken`` bytes; a single ``None`` where the whole picture fits."""
        if self.name in BASELINES:
            if memory is not None:
                raise ParameterError("max_memory", f"None, as {self.name} needs the whole picture", memory)
            return [None]
        uncut = lens.aperture.cats_eye > 0 or (
            self._networks is not None and self._networks.iunet is not None
        )
        if memory is None and uncut:
            return [None]
        height, width = defocus.shape
        max_coc_radius = math.ceil(_max_coc_radius(defocus, lens.known))
        crossed = None
        if self.classical_name == "rays":
            crossed = ray_reach(lens.lens_response, lens.place, max_coc_radius)
        if memory is None:
            reach = max(max_coc_radius, crossed or 0)
            memory, taken = working_memory(height, width, reach, self.classical_name), 0
            if memory is None:
                return [None]
        strips: list[Strip | None] = [
            *cut_strips(height, width, max_coc_radius, self.classical_name, memory, taken, crossed)
        ]
        if len(strips) <= 1:
            return [None]
        if self._networks is not None and self._networks.iunet is not None:
            expected = "None, as these networks need the whole picture at once"
            raise ParameterError("max_memory", expected, memory, "leave it out")
        return strips

    def _render_whole(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        lens: _Lens,
        curve: GammaCurve | None,
        report: Progress,
        gathered: _Gathered,
    ) -> EngineResult:
        steps = _STEPS if self._networks is None else 2 * _STEPS
        report(0, steps)
        classical = self._render_classical(
            image, defocus, lens, curve, progress=lambda share: report(int(share * _STEPS), steps)
        )
        report(_STEPS, steps)
        gathered.add(0, image, defocus, classical)
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
        if gathered.coarse is None:
            found = correct_level_by_level(self._networks, image, defocus, classical)
        else:
            correction = gathered.coarse.correct(self._networks)
            found = correction.apply(classical.bokeh, classical.error_map, defocus)
        report(2 * _STEPS, steps)
        return EngineResult(
            bokeh=found.bokeh,
            classical=classical.bokeh,
            neural=found.neural,
            error_map=found.error_map,
            mixed_pixels=classical.mixed_pixels,
        )

    def _render_strips(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        lens: _Lens,
        curve: GammaCurve | None,
        strips: Sequence[Strip | None],
        report: Progress,
        overwrite: bool,
        gathered: _Gathered,
    ) -> EngineResult:
        """Render strip by strip; then, with a network, correct strip by strip."""
        networks = self._networks
        results = [
            StripAccumulator(image, overwrite),
            StripAccumulator(defocus, overwrite and not self._reads_defocus_again),
        ]
        bokeh, error_map = (result.array for result in results)
        height, mixed = len(defocus), []
        steps = _STEPS * (len(strips) + (networks is not None))
        for done, strip in enumerate(strips):
            assert strip is not None
            report(_STEPS * done, steps)
            rows = slice(strip.first, strip.last)

            def tell(share: float, done: int = done) -> None:
                report(int(_STEPS * (done + share)), steps)

            part = self._render_classical(image[rows], defocus[rows], lens, curve, strip, tell)
            first, wanted = strip.first + strip.wanted.start, strip.wanted
            kept = part.rows(wanted)
            inner = slice(first, first + len(kept.bokeh))
            if kept.mixed_pixels is not None:
                mixed.append(kept.mixed_pixels.below(first))
            gathered.add(first, image[inner], defocus[inner], kept)
            later = strips[done + 1] if done + 1 < len(strips) else None
            for result, array in zip(results, (kept.bokeh, kept.error_map), strict=True):
                result.add(first, array, height if later is None else later.first)
            del part, kept, array  # before the next strip needs their memory
        if networks is not None and gathered.coarse is not None:
            report(_STEPS * len(strips), steps)
            correction = gathered.coarse.correct(networks)
            for rows in cut_row_blocks(bokeh.shape):
                found = correction.apply(bokeh[rows], error_map[rows], defocus[rows], rows.start)
                bokeh[rows], error_map[rows] = found.bokeh, found.error_map
        report(steps, steps)
        classical = bokeh if networks is None else None
        return EngineResult(
            bokeh=bokeh,
            classical=classical,
            neural=None,
            error_map=error_map,
            mixed_pixels=joined_surfaces(mixed),
        )

    def _render_classical(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        lens: _Lens,
        curve: GammaCurve | None,
        strip: Strip | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> ClassicalResult:
        known = lens.known
        if known is not None and strip is not None:
            known = known.in_rows(strip.first, strip.last)
        layers = lens.layers
        if layers is not None and strip is not None:
            layers = layers.in_rows(strip.first, strip.last)
        renderer = self._classical
        if self._behind_glass is not None and not lens.lens_response.is_ideal:
            renderer = self._behind_glass
        render = partial(
            renderer,
            strip=strip,
            lens_response=lens.lens_response,
            place=lens.place,
            progress=progress,
            pixel_filter=lens.pixel_filter,
            rays_share=lens.rays_share,
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
