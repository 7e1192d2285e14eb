"""The renderer that people use: a scene and settings in, the picture out; without torch."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_at_least, check_floats, check_kind, check_map, check_number
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.engines.engine import Engine
from bokehnet.errors import ParameterError
from bokehnet.forking import ForkSafeLock
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.tone import Highlights
from bokehnet.progress import Progress
from bokehnet.render.cancellation import CancelSignal, watched
from bokehnet.render.exposure import Optics, expose, leaning
from bokehnet.render.look import (
    make_aperture,
    make_effects,
    make_lens_response,
    prescription_lens,
)
from bokehnet.render.preparation import prepare
from bokehnet.render.result import RenderReport, RenderResult
from bokehnet.scene.scene import FocusedScene, Scene
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import (
    ApertureSettings,
    ColorSettings,
    DeviceName,
    LensSettings,
    RenderSettings,
    check_engine,
)

__all__ = ["BokehRenderer", "CancelSignal"]

Array = npt.NDArray[np.float32]
Made = TypeVar("Made")

# Engines, networks and looks that a renderer keeps.
_MOST_KEPT = 16


class BokehRenderer:
    """Renders bokeh on the CPU, or a CUDA device; for several threads at once. It can be pickled.

    What settings leave at their default is as the renderer was made.

    Args:
        engine: What renders: "rays" (the default), "scatter", "hybrid", "fast" or "neural".
        aperture: Shape of the lens opening; default a plain disc. Networks were trained on discs; with other
            shapes they correct what the classical half made of them.
        lens_response: What the lens does beyond focusing: aberrations, vignetting, a leaning plane of focus;
            default a perfect lens.
        character: Earlier name of ``lens_response``, which prevails.
        weights: Folder with the networks and their manifest; the package's own by default.
        threads: Threads inside a network; 0 takes all cores.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        session_options: An ``onnxruntime.SessionOptions`` to use in place of our own; ``threads`` is then
            left to it. A renderer that has them cannot be pickled.
        device: What computes: "cpu", "cuda" (a graphics card), or "auto": that where it can.

    Raises:
        ParameterError: Unknown engine, a provider that ONNX Runtime does not have here, or no CUDA device.
        ModelFileError: The engine needs networks, and they are missing or damaged.

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
        engine: str | None = None,
        *,
        aperture: Aperture | None = None,
        lens_response: LensResponse | None = None,
        character: LensResponse | None = None,
        weights: Path | str | None = None,
        threads: int = 0,
        providers: Sequence[str] = ("CPUExecutionProvider",),
        session_options: Any = None,
        device: DeviceName = "cpu",
    ) -> None:
        self.engine: str = "rays" if engine is None else engine
        self.aperture = aperture or Aperture()
        self.lens_response = lens_response or character or LensResponse()
        self._weights = None if weights is None else Path(weights)
        self._threads, self._providers, self._options = threads, tuple(providers), session_options
        self.device: str = device
        self._lock = ForkSafeLock()
        self._kept: dict[Any, Any] = {}
        self._engine(self.engine, self._weights, self.device)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_lock", "_kept")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = ForkSafeLock()
        self._kept = {}

    def warm_up(self, settings: RenderSettings | None = None) -> None:
        """Open the networks, load or compile the kernels and run them once, before the first picture.

        Args:
            settings: Of the pictures that come: their engine, opening and lens; default those of the
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
        with errors_named_as("engine", {"engine": "name"} | leaning(settings)):
            engine.render(image, defocus, aperture=aperture, lens_response=lens_response)

    def check(self, settings: RenderSettings) -> None:
        """Raise unless all that settings name can be made: networks, a lens, files of a look. It is kept.

        Raises:
            BokehnetError: A name is unknown, a file is missing or wrong, or a lens does not open so far.

        Examples:
            >>> from bokehnet.settings.settings import LensSettings
            >>> BokehRenderer().check(RenderSettings(lens=LensSettings(name="petzval", f_number=4)))
        """
        check_engine(settings, self._engine_of(settings)[0])
        prescription_lens(settings.lens)
        self._look(settings)
        self._engine(*self._engine_of(settings))

    @overload
    def render(
        self,
        scene: Scene | FocusedScene,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
        /,
        *,
        cancel: CancelSignal | None = None,
        overwrite: bool = False,
    ) -> RenderResult: ...

    @overload
    def render(
        self,
        image: npt.NDArray[np.floating],
        defocus: npt.NDArray[np.floating] | None = None,
        progress: Progress | None = None,
        *,
        disparity: npt.NDArray[np.floating] | None = None,
        blur: float | None = None,
        focus: float | None = None,
        gamma: float = 1.0,
        highlights: Highlights | None = None,
        max_memory: int | None = None,
        memory_in_use: int = 0,
        pixel_filter: PixelFilter | None = None,
        known: KnownSurfaces | None = None,
        expected_error: bool = False,
        cancel: CancelSignal | None = None,
        overwrite: bool = False,
    ) -> RenderResult: ...

    def render(  # type: ignore[misc]  # mypy does not see that positions agree
        self,
        image: Any,
        defocus: Any = None,
        progress: Progress | None = None,
        *,
        cancel: CancelSignal | None = None,
        overwrite: bool = False,
        **options: Any,
    ) -> RenderResult:
        """Render a scene by settings; or an array, from its defocus, or from disparity, blur and focus.

        Args:
            image: A scene (from :func:`make_scene`, :func:`read_scene` or :meth:`prepare`); or the
                all-in-focus picture, scene-linear, (H, W, 3), where values below 0 count as 0.
            defocus: With a scene its settings; else the signed blur radius in pixels, (H, W), positive in
                front of focus.
            progress: Called with (steps done, steps in all).
            cancel: Is asked between steps; once it is set, rendering ends.
            overwrite: Whether the result may take the place of image and defocus, which are of no use
                afterwards; in strips this saves their memory.
            options: With arrays: ``disparity``, relative, (H, W), near is large, with ``blur``, the radius
                in pixels per unit of it, and ``focus``, its value that stays sharp, in place of ``defocus``;
                ``gamma``, ``highlights``, ``pixel_filter``, ``max_memory``, ``memory_in_use``, ``known`` and
                ``expected_error`` of :meth:`bokehnet.engines.engine.Engine.render`.

        Raises:
            ShapeError: Arrays are not of the shapes above, or map and picture differ in size.
            ParameterError: What is given does not fit together, or is out of range; NaN or infinity; arrays
                of anything but floats. Those of 16 and 64 bits are taken as float32.
            LensError: The lens cannot focus there.
            RenderCancelled: ``cancel`` was set.
        """
        watch = watched(progress, cancel)
        if isinstance(image, Scene | FocusedScene):
            settings = RenderSettings() if defocus is None else defocus
            check_kind("settings", settings, RenderSettings)
            if isinstance(image, Scene):
                image = self.prepare(image, settings, cancel=cancel)
            name, weights, device = self._engine_of(settings)
            check_engine(settings, name)  # may be others than those of `prepare`
            engine = self._engine(name, weights, device)
            return expose(image, settings, engine, self._look(settings), watch, overwrite)
        return self._render_arrays(image, defocus, watch, overwrite, **options)

    def prepare(
        self,
        scene: Scene,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
        *,
        cancel: CancelSignal | None = None,
        plan: RepairPlan | None = None,
    ) -> FocusedScene:
        """Repair the map of a scene and find its focus: all but the blur itself.

        Args:
            scene: The scene.
            settings: All that is asked for.
            progress: Called with (steps done, steps in all) of the repair.
            cancel: Is asked between steps; once it is set, the work ends.
            plan: What the shot has decided about the repair; default: each frame for itself.

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
        return prepare(scene, settings, engine, watched(progress, cancel), self._repairer, plan)

    def _render_arrays(
        self,
        image: npt.NDArray[np.floating],
        defocus: npt.NDArray[np.floating] | None,
        report: Progress,
        overwrite: bool,
        disparity: npt.NDArray[np.floating] | None = None,
        blur: float | None = None,
        focus: float | None = None,
        **options: Any,
    ) -> RenderResult:
        if defocus is None:
            defocus = _from_disparity(disparity, blur, focus)
        elif not (disparity is None and blur is None and focus is None):
            expected = "either this, or `disparity`, `blur` and `focus`"
            raise ParameterError("defocus", expected, defocus, "leave one out", shown="both")
        engine = self._engine(self.engine, self._weights, self.device)
        rendered = engine.render(
            image,
            defocus,
            report,
            aperture=self.aperture,
            lens_response=self.lens_response,
            overwrite=overwrite,
            **options,
        )
        return RenderResult(
            bokeh=rendered.bokeh,
            classical=rendered.classical,
            neural=rendered.neural,
            error_map=rendered.error_map,
            defocus=None if overwrite else np.asarray(defocus, np.float32),
            mixed_pixels=rendered.mixed_pixels,
            expected_error=rendered.expected_error,
            report=RenderReport(
                engine=engine.name,
                largest_blur=rendered.largest_blur,
                focus_disparity=focus,
            ),
        )

    def _look(self, settings: RenderSettings) -> Optics:
        """Aperture, lens and effects of the settings, made once."""

        def make() -> Optics:
            aperture, lens, color = settings.aperture, settings.lens, settings.color
            plain = lens == LensSettings() and color == ColorSettings()
            return (
                self.aperture if aperture == ApertureSettings() else make_aperture(aperture),
                self.lens_response if plain else make_lens_response(lens, color),
                make_effects(settings.effects),
            )

        return self._keep((settings.aperture, settings.lens, settings.color, settings.effects), make)

    def _engine_of(self, settings: RenderSettings) -> tuple[str, Path | None, str]:
        """Name, weights and device of the engine that the settings ask for."""
        asked = settings.engine
        device = self.device if asked.device == "cpu" else asked.device
        return asked.name or self.engine, asked.weights or self._weights, device

    def _repairer(self) -> DisparityRepair:
        return self._keep("repair", lambda: DisparityRepair(threads=self._threads))

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

        return self._keep((name, weights, device), make)

    def _keep(self, key: Any, make: Callable[[], Made]) -> Made:
        """What ``make`` gave for a key, made once for all threads; what was asked for last is kept."""
        with self._lock:
            made: Made = self._kept.pop(key) if key in self._kept else make()
            self._kept[key] = made
            if len(self._kept) > _MOST_KEPT:
                del self._kept[next(iter(self._kept))]
            return made


def _from_disparity(
    disparity: npt.NDArray[np.floating] | None, blur: float | None, focus: float | None
) -> Array:
    """Defocus of a disparity map."""
    given = {"disparity": disparity, "blur": blur, "focus": focus}
    missing = [name for name, value in given.items() if value is None]
    if disparity is None or blur is None or focus is None:
        if len(missing) == 3:
            raise ParameterError("defocus", "either this, or `disparity`, `blur` and `focus`", None)
        needed = " and ".join(f"`{name}`" for name in missing)
        expected = "a value beside `disparity`, `blur` and `focus`, which go together"
        raise ParameterError(missing[0], expected, None, f"give {needed}, or `defocus` alone")
    check_at_least("blur", blur, 0)
    check_number("focus", focus)
    check_map("disparity", disparity)
    check_floats("disparity", disparity, "divide it by the value that is to be 1, as 255")
    defocus: Array = defocus_from_disparity(np.asarray(disparity), blur, focus)
    return defocus
