"""Public renderer: scene and settings, or arrays, to the picture; does not need torch."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from bokehnet.checks import (
    check_at_least,
    check_floats,
    check_kind,
    check_map,
    check_number,
    check_same_size,
)
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.processes.forking import ForkSafeLock
from bokehnet.progress import Progress
from bokehnet.render.cancellation import CancelSignal, cancellable
from bokehnet.render.deprecated_arrays import render_earlier_form
from bokehnet.render.exposure.exposure import Optics, expose, tilt_parameter
from bokehnet.render.layouts import expose_layout
from bokehnet.render.look import (
    make_aperture,
    make_effects,
    make_lens_response,
)
from bokehnet.render.result import RenderReport, RenderResult
from bokehnet.scene.preparation.picture_cache import DEFAULT_CACHE_BYTES, PictureCache
from bokehnet.scene.preparation.preparation import prepare
from bokehnet.scene.prescription import prescription_lens
from bokehnet.scene.scene import FocusedScene, Scene
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import (
    ApertureSettings,
    ColorSettings,
    DeviceName,
    EngineName,
    FocusSettings,
    LensSettings,
    RenderSettings,
    check_engine,
)

__all__ = ["BokehRenderer", "CancelSignal"]

Array = npt.NDArray[np.float32]
Cached = TypeVar("Cached")

# Maximum number of engines, networks and looks in the cache of a renderer.
_MAX_CACHED = 16

# Fraction of the memory bound of a render, as a divisor, that kept maps may use.
_CACHE_FRACTION = 8


class BokehRenderer:
    """Renderer of bokeh on the CPU or a CUDA device, thread-safe and picklable.

    Settings with default values fall back to the renderer's own arguments.

    Args:
        engine: Name of the engine: "rays" (default), "scatter", "hybrid", "fast" or "neural".
        aperture: Shape of the aperture. Default: a disc. Networks were trained on discs; for other shapes
            they correct the classical render of that shape.
        lens_response: Properties of the lens beyond focusing: aberrations, vignetting, a tilted plane of
            focus. Default: a perfect lens.
        character: Earlier name of ``lens_response``, which overrides it.
        weights: Folder with the networks and their manifest. Default: those of the package.
        threads: Threads inside a network; 0 uses all cores.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        session_options: ``onnxruntime.SessionOptions`` to use instead of the default ones; ``threads`` is
            then ignored, and the renderer cannot be pickled.
        device: Device that renders: "cpu", "cuda" (a graphics card), or "auto" ("cuda" where possible).
        cache_bytes: Upper bound of the repaired maps that are kept, bytes: another focus, blur or look of a
            picture then needs no other repair. 0 keeps none.

    Raises:
        ParameterError: Unknown engine, unavailable provider of ONNX Runtime, or no CUDA device.
        ModelFileError: The engine needs networks that are missing or damaged.

    Examples:
        >>> import numpy as np
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> from bokehnet.settings.settings import CameraSettings, FocusSettings, RenderSettings
        >>> disparity = np.tile(np.linspace(0, 1, 32, dtype=np.float32), (24, 1))
        >>> scene = make_scene(np.ones((24, 32, 3), np.float32), RelativeDisparity(map=disparity))
        >>> settings = RenderSettings(camera=CameraSettings(blur=8), focus=FocusSettings(value=0.5))
        >>> result = BokehRenderer("scatter").render(scene, settings)
        >>> result.bokeh.shape, round(result.report.largest_blur, 3)
        ((24, 32, 3), 4.0)
    """

    def __init__(
        self,
        engine: EngineName | None = None,
        *,
        aperture: Aperture | None = None,
        lens_response: LensResponse | None = None,
        character: LensResponse | None = None,
        weights: Path | str | None = None,
        threads: int = 0,
        providers: Sequence[str] = ("CPUExecutionProvider",),
        session_options: Any = None,
        device: DeviceName = "cpu",
        cache_bytes: int = DEFAULT_CACHE_BYTES,
    ) -> None:
        self.engine: str = "rays" if engine is None else engine
        self.aperture = aperture or Aperture()
        self.lens_response = lens_response or character or LensResponse()
        self._weights = None if weights is None else Path(weights)
        self._threads, self._providers, self._options = threads, tuple(providers), session_options
        self.device: str = device
        self._cache_bytes = cache_bytes
        self._pictures = PictureCache(cache_bytes)
        self._lock = ForkSafeLock()
        self._kept: dict[Any, Any] = {}
        self._engine(self.engine, self._weights, self.device)

    def __getstate__(self) -> dict[str, Any]:
        dropped = ("_lock", "_kept", "_pictures")
        return {name: value for name, value in self.__dict__.items() if name not in dropped}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._pictures = PictureCache(self._cache_bytes)
        self._lock = ForkSafeLock()
        self._kept = {}

    def warm_up(self, settings: RenderSettings | None = None) -> None:
        """Open the networks, load or compile the kernels, and run them once before the first picture.

        Args:
            settings: Settings of the coming pictures: engine, aperture and lens. Default: those of the
                renderer.
        """
        image = np.zeros((64, 64, 3), np.float32)
        image[::8] = 1
        defocus = np.full((64, 64), -12, np.float32)
        defocus[:, 32:] = 12
        settings = settings or RenderSettings()
        if settings.depth.repair != "off" and settings.input.defocus is None:
            self._repairer()
        aperture, lens_response, _ = self._look(settings)
        engine = self._engine(*self._engine_of(settings))
        with errors_named_as("engine", {"engine": "name"} | tilt_parameter(settings)):
            options = RenderOptions(aperture=aperture, lens_response=lens_response)
            engine.render(image, defocus, options=options)

    def check(self, settings: RenderSettings) -> None:
        """Raise unless networks, lens and files of the settings can be loaded; caches them.

        Raises:
            BokehnetError: A name is unknown, a file is missing or invalid, or a lens does not open that wide.

        Examples:
            >>> from bokehnet.settings.settings import LensSettings
            >>> BokehRenderer().check(RenderSettings(lens=LensSettings(name="petzval", f_number=4)))
        """
        check_engine(settings, self._engine_of(settings)[0])
        prescription_lens(settings.lens)
        self._look(settings)
        self._engine(*self._engine_of(settings))

    def render(
        self,
        scene: Scene | FocusedScene | None = None,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
        *,
        focus: float | FocusSettings | None = None,
        cancel: CancelSignal | None = None,
        overwrite: bool = False,
        **deprecated: Any,
    ) -> RenderResult:
        """Render a scene with settings.

        The renderer keeps the repaired map, so that the same scene with another focus, blur or look costs
        the blur only.

        Args:
            scene: Scene from :func:`make_scene`, :func:`read_scene` or :meth:`prepare`.
            settings: Settings of the render; default: those of :class:`RenderSettings`.
            progress: Called with (steps done, total steps).
            focus: Focus in place of that of the settings: a disparity of 0 to 1, with metric depth a
                distance in metres, or focus settings.
            cancel: Cancellation signal, checked between steps.
            overwrite: True if the result may overwrite image and defocus of a prepared scene, which are
                invalid afterwards; saves their memory when rendering in strips.
            deprecated: Arguments of :meth:`render_arrays`, as in version 0.1; version 0.3 removes them.

        Raises:
            ParameterError: Settings are inconsistent or out of range, or ``scene`` is no scene.
            LensError: The lens cannot focus there.
            RenderCancelled: ``cancel`` was set.
        """
        if deprecated or isinstance(scene, np.ndarray):
            named = {"focus": focus, "cancel": cancel, "overwrite": overwrite}
            return render_earlier_form(self.render_arrays, (scene, settings, progress), named | deprecated)
        check_kind("scene", scene, Scene, FocusedScene)
        assert scene is not None
        settings = RenderSettings() if settings is None else settings
        check_kind("settings", settings, RenderSettings)
        if isinstance(scene, Scene):
            if focus is not None:
                settings = replace(settings, focus=_focus_settings(focus, scene))
            scene = self.prepare(scene, settings, cancel=cancel)
        elif focus is not None:
            fields = {"value": focus} if not isinstance(focus, FocusSettings) else asdict(focus)
            scene = scene.refocus(**fields)
        name, weights, device = self._engine_of(settings)
        check_engine(settings, name)  # settings may differ from those of `prepare`
        engine = self._engine(name, weights, device)
        watch = cancellable(progress, cancel)
        optics = self._look(settings)
        if settings.input.projection != "flat" or settings.input.stereo is not None:
            return expose_layout(scene, settings, engine, optics, watch)
        if settings.engine.max_memory is not None:
            self._pictures.trim(settings.engine.max_memory // _CACHE_FRACTION)
        return expose(scene, settings, engine, optics, watch, overwrite, self._pictures.nbytes)

    def render_arrays(
        self,
        image: npt.NDArray[np.floating],
        defocus: npt.NDArray[np.floating] | None = None,
        progress: Progress | None = None,
        *,
        disparity: npt.NDArray[np.floating] | None = None,
        blur: float | None = None,
        focus: float | None = None,
        options: RenderOptions | None = None,
        cancel: CancelSignal | None = None,
    ) -> RenderResult:
        """Render an array with its defocus, or with disparity, blur and focus, without repair of the map.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3), with values below 0 clipped to 0.
            defocus: Signed blur radius in pixels, (H, W), positive in front of focus.
            progress: Called with (steps done, total steps).
            disparity: Relative disparity, (H, W), near is large; with ``blur`` and ``focus`` in place of
                ``defocus``.
            blur: Blur radius in pixels per unit of disparity, at least 0.
            focus: Disparity in focus.
            options: Further options; its aperture and lens response default to those of the renderer.
            cancel: Cancellation signal, checked between steps.

        Raises:
            ShapeError: Arrays do not have the shapes above, or map and picture differ in size.
            ParameterError: Arguments are inconsistent or out of range; NaN or infinity; arrays of another
                type than floats. Floats of 16 and 64 bits are converted to float32.
            RenderCancelled: ``cancel`` was set.

        Examples:
            >>> image, defocus = np.ones((24, 32, 3), np.float32), np.full((24, 32), 4, np.float32)
            >>> options = RenderOptions(gamma=2.0)
            >>> BokehRenderer("scatter").render_arrays(image, defocus, options=options).bokeh.shape
            (24, 32, 3)
        """
        if defocus is None:
            defocus = _from_disparity(disparity, blur, focus)
            if np.ndim(image) == 3:  # the engine refuses any other
                check_same_size("image", image, "disparity", defocus)
        elif not (disparity is None and blur is None and focus is None):
            expected = "either this, or `disparity`, `blur` and `focus`"
            raise ParameterError("defocus", expected, defocus, "leave one out", shown="both")
        check_kind("options", options, RenderOptions, optional=True)
        options = options or RenderOptions()
        options = replace(
            options,
            aperture=options.aperture or self.aperture,
            lens_response=options.lens_response or self.lens_response,
        )
        engine = self._engine(self.engine, self._weights, self.device)
        rendered = engine.render(image, defocus, cancellable(progress, cancel), options)
        return RenderResult(
            bokeh=rendered.bokeh,
            classical=rendered.classical,
            neural=rendered.neural,
            error_map=rendered.error_map,
            defocus=None if options.overwrite else np.asarray(defocus, np.float32),
            mixed_pixels=rendered.mixed_pixels,
            expected_error=rendered.expected_error,
            report=RenderReport(
                engine=engine.name,
                largest_blur=rendered.largest_blur,
                focus_disparity=focus,
            ),
        )

    def prepare(
        self,
        scene: Scene,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
        *,
        cancel: CancelSignal | None = None,
        plan: RepairPlan | None = None,
    ) -> FocusedScene:
        """Repair the map of a scene and focus it: all steps before the blur.

        Args:
            scene: Scene to prepare.
            settings: Settings of the render.
            progress: Called with (steps done, total steps) of the repair.
            cancel: Cancellation signal, checked between steps.
            plan: Repair plan of the shot. Default: each frame decides independently.

        Raises:
            BokehnetError: As :meth:`render`.

        Examples:
            >>> import numpy as np
            >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
            >>> from bokehnet.scene.scene import make_scene
            >>> from bokehnet.settings.settings import CameraSettings, FocusSettings
            >>> disparity = np.tile(np.linspace(0, 1, 32, dtype=np.float32), (24, 1))
            >>> scene = make_scene(np.ones((24, 32, 3), np.float32), RelativeDisparity(map=disparity))
            >>> settings = RenderSettings(camera=CameraSettings(blur=8), focus=FocusSettings(at=(31, 0)))
            >>> float(BokehRenderer("scatter").prepare(scene, settings).defocus.min())
            -8.0
        """
        settings = RenderSettings() if settings is None else settings
        check_kind("settings", settings, RenderSettings)
        engine, *_ = self._engine_of(settings)
        check_engine(settings, engine)
        watch = cancellable(progress, cancel)
        return prepare(scene, settings, engine, watch, self._repairer, plan, self._pictures)

    def _look(self, settings: RenderSettings) -> Optics:
        """Return aperture, lens and effects of the settings, cached."""

        def make() -> Optics:
            aperture, lens, color = settings.aperture, settings.lens, settings.color
            is_default = lens == LensSettings() and color == ColorSettings()
            return (
                self.aperture if aperture == ApertureSettings() else make_aperture(aperture),
                self.lens_response if is_default else make_lens_response(lens, color),
                make_effects(settings.effects),
            )

        return self._cached((settings.aperture, settings.lens, settings.color, settings.effects), make)

    def _engine_of(self, settings: RenderSettings) -> tuple[str, Path | None, str]:
        """Return name, weights and device of the engine of the settings."""
        requested = settings.engine
        device = self.device if requested.device == "cpu" else requested.device
        return requested.name or self.engine, requested.weights or self._weights, device

    def _repairer(self) -> DisparityRepair:
        return self._cached("repair", DisparityRepair)

    def _engine(self, name: str, weights: Path | None, device: str) -> Engine:
        def make() -> Engine:
            return Engine(
                name,
                weights=weights,
                threads=self._threads,
                providers=self._providers,
                session_options=self._options,
                device=device,
            )

        return self._cached((name, weights, device), make)

    def _cached(self, key: Any, make: Callable[[], Cached]) -> Cached:
        """Return the result of ``make`` for a key from a thread-safe least-recently-used cache."""
        with self._lock:
            value: Cached = self._kept.pop(key) if key in self._kept else make()
            self._kept[key] = value
            if len(self._kept) > _MAX_CACHED:
                del self._kept[next(iter(self._kept))]
            return value


def _focus_settings(focus: float | FocusSettings, scene: Scene) -> FocusSettings:
    if isinstance(focus, FocusSettings):
        return focus
    return FocusSettings(distance=focus) if scene.depth.kind == "metric" else FocusSettings(value=focus)


def _from_disparity(
    disparity: npt.NDArray[np.floating] | None, blur: float | None, focus: float | None
) -> Array:
    """Return the defocus of a disparity map."""
    arguments = {"disparity": disparity, "blur": blur, "focus": focus}
    missing = [name for name, value in arguments.items() if value is None]
    if disparity is None or blur is None or focus is None:
        if len(missing) == 3:
            raise ParameterError("defocus", "either this, or `disparity`, `blur` and `focus`", None)
        needed = " and ".join(f"`{name}`" for name in missing)
        expected = "a value, as `disparity`, `blur` and `focus` go together"
        raise ParameterError(missing[0], expected, None, f"give {needed}, or `defocus` alone")
    check_at_least("blur", blur, 0)
    check_number("focus", focus)
    check_map("disparity", disparity)
    check_floats("disparity", disparity, "divide it by the value that maps to 1, such as 255")
    defocus: Array = defocus_from_disparity(np.asarray(disparity, np.float32), blur, focus)
    return defocus
