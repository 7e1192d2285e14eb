"""What stays sharp, and how strongly the rest is blurred: from options and the map of a scene to defocus."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from bokehnet.checks import check_at_least, check_number
from bokehnet.cli.leaning_focus import check_lean, leaning_focus, value_at
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.cli.scene_map import SceneMap
    from bokehnet.io.camera import Camera
    from bokehnet.optics.aberration_map import AberrationMap

__all__ = ["Focus", "parse_pixel", "parse_plane", "parse_range"]

_RELATIVE = ("focus", "blur")
_METRIC = ("focus_distance", "focal_length", "f_number", "sensor_width")
_LENS = ("focal_length", "f_number", "sensor_width")


@dataclass(frozen=True, kw_only=True, slots=True)
class Focus:
    """Numbers as they were given; None where one was left out.

    Attributes:
        focus_at: Pixel (x, y) that stays sharp.
        focus_range: Two ends between which all stays sharp, relative disparity or metres, in any order.
        focus: Relative disparity that stays sharp, 0 to 1.
        focus_distance: Distance that stays sharp, metres.
        blur: Blur radius in pixels per unit of relative disparity.
        focal_length: Of the lens, mm.
        f_number: Focal length over the pupil's diameter.
        sensor_width: What the width of the picture covers on the sensor, mm.
        focus_plane: Three pixels (x, y); the plane through what they show stays sharp.
        tilt: Lean of the plane that stays sharp, about x and about y, degrees; it turns about ``focus_at``,
            or the middle of the picture.
    """

    focus_at: tuple[int, int] | None = None
    focus_range: tuple[float, float] | None = None
    focus: float | None = None
    focus_distance: float | None = None
    blur: float | None = None
    focal_length: float | None = None
    f_number: float | None = None
    sensor_width: float | None = None
    focus_plane: tuple[tuple[int, int], tuple[int, int], tuple[int, int]] | None = None
    tilt: tuple[float, float] = (0.0, 0.0)

    def check(self, metric: bool, source: str, complete: bool = False) -> None:
        """Raise ``ParameterError`` unless the numbers can go with a map of this kind.

        Args:
            metric: Whether the map tells distances; else relative disparity.
            source: What made it so, for the message.
            complete: Whether no file can tell what stays sharp.
        """
        if wrong := self._given(_RELATIVE if metric else _METRIC):
            raise ParameterError(f"{', '.join(map(_option, wrong))} cannot go with {source}; leave it out")
        if not metric and self.blur is None:
            raise ParameterError(f"{source} needs --blur")
        found = self._given(_ways(metric))
        if len(found) > 1 or (complete and not found):
            raise ParameterError(f"expected one of {_options(_ways(metric))}, found {_options(found)}")
        if self.blur is not None:
            check_at_least("--blur", self.blur, 0)
        for value in (self.focus, *(self.focus_range or ())) if not metric else ():
            if value is not None and not 0 <= value <= 1:
                name = _option("focus" if self.focus is not None else "focus_range")
                raise ParameterError(f"{name}: expected a relative disparity in 0..1, got {value:g}")
        if metric and self.focus_range is not None and not min(self.focus_range) > 0:
            raise ParameterError(f"--focus-range: expected metres above 0, got {min(self.focus_range):g}")
        if self.sensor_width is not None:
            check_number("--sensor-width", self.sensor_width)
            if self.sensor_width <= 0:
                raise ParameterError(f"--sensor-width: expected mm above 0, got {self.sensor_width:g}")
        check_lean(self)

    def with_numbers(self, numbers: Mapping[str, float]) -> "Focus":
        """Return these numbers with some replaced, by their names."""
        changes: dict[str, Any] = dict(numbers)
        return replace(self, **changes)

    def filled_by(self, camera: "Camera | None") -> "Focus":
        """Return these numbers, and those of ``camera`` where none was given."""
        if camera is None:
            return self
        told = {name: getattr(camera, name) for name in _LENS if getattr(self, name) is None}
        if camera.focus_distance is not None and not self._given(_ways(True)):
            told["focus_distance"] = camera.focus_distance / 1000
        return self.with_numbers(told)

    def defocus(self, scene: "SceneMap") -> "np.ndarray":
        """Return the signed blur radius of each pixel of ``scene`` in pixels, (H, W).

        Raises:
            ParameterError: Something is missing, or the pixel lies outside.
            LensError: The lens cannot focus there.
        """
        from bokehnet.optics.focus_range import defocus_outside_range

        chosen = self._complete(scene)
        if chosen._leans:
            sharp_at = chosen._plane(scene)
        else:
            sharp_at = chosen._lens(scene) if scene.metric else chosen._scale(scene)
        near, far = chosen._ends(scene)
        if near == far:
            return sharp_at(near)
        defocus: np.ndarray = defocus_outside_range(sharp_at(near), sharp_at(far))
        return defocus

    def pencil(self, scene: "SceneMap") -> "AberrationMap | None":
        """Return what a leaning plane of focus does to the rays of the lens; None where it does not lean.

        Raises:
            ParameterError: As :meth:`defocus`.
            LensError: The same.
        """
        from bokehnet.optics.focus_plane import plane_aberration_map

        chosen = self._complete(scene)
        return (
            plane_aberration_map(*leaning_focus(chosen, scene, chosen._ends(scene)[0]))
            if chosen._leans
            else None
        )

    def complete(self, scene: "SceneMap") -> "tuple[Focus, float]":
        """Return these numbers with those of the picture's files, and the largest disparity that stays sharp.

        Raises:
            ParameterError: Something is missing, or the pixel lies outside.
        """
        chosen = self._complete(scene)
        return chosen, chosen._ends(scene)[0]

    @property
    def _leans(self) -> bool:
        return self.focus_plane is not None or any(self.tilt)

    def _complete(self, scene: "SceneMap") -> "Focus":
        """These numbers, and those of the picture's files where none was given."""
        chosen = self.filled_by(scene.camera if scene.metric else None)
        if scene.metric and (missing := [name for name in _LENS if getattr(chosen, name) is None]):
            raise ParameterError(f"{scene.source} needs {_options(missing)}; the picture's file tells none")
        return chosen

    def _ends(self, scene: "SceneMap") -> tuple[float, float]:
        """The largest and the smallest disparity that stay sharp, in the unit of the map."""
        if self.focus_range is None:
            disparity = self._focus_disparity(scene)
            return disparity, disparity
        ends = [_inverse_mm(end) if scene.metric else end for end in self.focus_range]
        return max(ends), min(ends)

    def _plane(self, scene: "SceneMap") -> Callable[[float], "np.ndarray"]:
        """From a disparity, where the plane turns, to the defocus with the focus there."""
        import numpy as np

        from bokehnet.optics.focus_plane import plane_defocus

        def sharp_at(disparity: float) -> np.ndarray:
            plane, blur = leaning_focus(self, scene, disparity)
            with np.errstate(over="ignore"):  # told by the renderer's check
                defocus: np.ndarray = plane_defocus(
                    scene.disparity, blur, plane, (scene.window.x, scene.window.y)
                )
            return defocus

        return sharp_at

    def _scale(self, scene: "SceneMap") -> Callable[[float], "np.ndarray"]:
        """From a relative disparity to the defocus with the focus there."""
        import numpy as np

        from bokehnet.optics.coc import defocus_from_disparity

        def sharp_at(disparity: float) -> np.ndarray:
            with np.errstate(over="ignore"):  # a blur beyond float32 is told by the renderer's check
                defocus: np.ndarray = defocus_from_disparity(scene.disparity, self.blur, disparity)
            return defocus

        return sharp_at

    def _lens(self, scene: "SceneMap") -> Callable[[float], "np.ndarray"]:
        """From an inverse distance in 1/mm to the defocus with the focus there."""
        from bokehnet.lenses import ThinLens, defocus_map

        focal_length, f_number, sensor_width = self.focal_length, self.f_number, self.sensor_width
        assert focal_length is not None
        assert f_number is not None
        assert sensor_width is not None

        def sharp_at(disparity: float) -> "np.ndarray":
            distance = 1 / disparity if disparity > 0 else math.inf
            lens = ThinLens(focal_length=focal_length, f_number=f_number, focus_distance=distance)
            defocus: np.ndarray = defocus_map(
                scene.disparity, lens, sensor_width / scene.window.display_width
            )
            return defocus

        return sharp_at

    def _focus_disparity(self, scene: "SceneMap") -> float:
        """What stays sharp, in the unit of the map; where a plane leans, in its pixel or in the middle."""
        if self.focus_plane is not None:
            window = scene.window
            middle = (window.display_width - 1) / 2, (window.display_height - 1) / 2
            return float(leaning_focus(self, scene, 0.0)[0].at(*middle))
        if self.focus_at is not None:
            return value_at(self.focus_at, scene, "--focus-at")
        if self.focus is not None:
            return self.focus
        if self.focus_distance is not None:
            return _inverse_mm(self.focus_distance)
        if scene.focus is not None:
            return scene.focus
        raise ParameterError(
            f"expected one of {_options(_ways(scene.metric))}, found none; the picture's file tells no focus"
        )

    def _given(self, names: tuple[str, ...]) -> list[str]:
        return [name for name in names if getattr(self, name) is not None]


def parse_pixel(text: str, option: str = "--focus-at") -> tuple[int, int]:
    """Return the pixel of ``X,Y``; ``ParameterError`` names ``option`` where it is none."""
    try:
        x, y = (int(part) for part in text.split(","))
    except ValueError as error:
        raise ParameterError(f"{option}: expected two whole numbers X,Y of a pixel, got {text!r}") from error
    return x, y


def parse_plane(texts: tuple[str, str, str]) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
    """Return the three pixels of ``X,Y`` each; ``ParameterError`` where one is none."""
    first, second, third = (parse_pixel(text, "--focus-plane") for text in texts)
    return first, second, third


def parse_range(text: str, option: str) -> tuple[float, float]:
    """Return the two numbers of ``A,B``; ``ParameterError`` names ``option`` where they are none."""
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ParameterError(f"{option}: expected two numbers such as 0.5,2, got {text!r}") from error
    if math.isnan(first) or math.isnan(second):
        raise ParameterError(f"{option}: expected two numbers such as 0.5,2, got {text!r}")
    return first, second


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _options(names: Sequence[str]) -> str:
    if not names:
        return "none"
    *first, last = map(_option, names)
    return f"{', '.join(first)} and {last}" if first else last


def _ways(metric: bool) -> tuple[str, ...]:
    """The ways to say what stays sharp."""
    return ("focus_distance" if metric else "focus", "focus_at", "focus_range", "focus_plane")


def _inverse_mm(metres: float) -> float:
    if not metres > 0:
        raise ParameterError(f"--focus-distance: expected metres above 0, got {metres:g}")
    return 1 / (1000 * metres)
