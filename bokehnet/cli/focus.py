"""What stays sharp, and how blurred the rest is: the options of ``bokehnet render`` that make the defocus."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["FocusOptions"]


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusOptions:
    """Options as they were typed; None where one was left out.

    Attributes:
        disparity: File with relative disparity.
        depth: File with metric depth.
        channel: Channel of the map in its file.
        resize: Whether a map of another size is brought to the picture's.
        refine: Whether its edges are moved to the picture's, one of ``REFINE_MODES``.
        relative: Numbers that go with ``disparity``, by the option's name.
        metric: Numbers that go with ``depth``.
        focus_at: Pixel ``X,Y`` that stays sharp.
    """

    disparity: Path | None
    depth: Path | None
    channel: str | None
    resize: bool
    refine: str
    relative: dict[str, float | None]
    metric: dict[str, float | None]
    focus_at: str | None

    def check(self) -> None:
        """Raise unless exactly one kind of map is given, with all of its options and none of the other's."""
        from bokehnet.checks import check_choice
        from bokehnet.inference.refine import REFINE_MODES

        check_choice("--refine-disparity", self.refine, REFINE_MODES)
        if (self.disparity is None) == (self.depth is None):
            found = "neither" if self.disparity is None else "both"
            raise ParameterError(f"expected one of --disparity and --depth, found {found}")
        if self.disparity is not None:
            mine, needed, focusing = "--disparity", ["--blur"], "--focus"
            given, other = self.relative, self.metric
        else:
            mine, needed, focusing = (
                "--depth",
                ["--focal-length", "--f-number", "--sensor-width"],
                "--focus-distance",
            )
            given, other = self.metric, self.relative
        if wrong := [name for name, value in other.items() if value is not None]:
            raise ParameterError(f"{', '.join(wrong)} cannot go with {mine}; leave it out")
        if missing := [name for name in needed if given[name] is None]:
            raise ParameterError(f"{mine} needs {', '.join(missing)}")
        if (given[focusing] is None) == (self.focus_at is None):
            found = "neither" if self.focus_at is None else "both"
            raise ParameterError(f"expected one of {focusing} and --focus-at, found {found}")

    def read_defocus(self, picture: "np.ndarray") -> "np.ndarray":
        """Read the map and return the defocus of ``picture`` (H, W, 3): signed radius in pixels, (H, W)."""
        from bokehnet.checks import check_same_size
        from bokehnet.io.maps import read_depth, read_disparity, resize_map
        from bokehnet.optics.coc import disparity_from_depth

        height, width = picture.shape[:2]
        if self.disparity is not None:
            kind, values = "disparity", read_disparity(self.disparity, self.channel)
        else:  # sky at infinite depth is 0 from here on
            assert self.depth is not None
            kind, values = "depth", disparity_from_depth(read_depth(self.depth, self.channel))
        if self.resize and values.shape != (height, width):
            values = resize_map(values, height, width)
        hint = "--resize-disparity brings them together"
        check_same_size("the picture", picture, f"its {kind}", values, hint)
        if self.refine != "off":
            from bokehnet.inference.refine import DisparityRefiner

            values = DisparityRefiner()(picture, values, self.refine)
        chosen = None if self.focus_at is None else _value_at(self.focus_at, values)
        if kind == "depth":
            return _metric_defocus(values, self.metric, chosen, width)
        blur, focus = self.relative.values()
        assert blur is not None
        return _relative_defocus(values, blur, focus if chosen is None else chosen)


def _value_at(focus_at: str, values: "np.ndarray") -> float:
    """Value of the map at the pixel ``X,Y``."""
    height, width = values.shape
    try:
        x, y = (int(part) for part in focus_at.split(","))
    except ValueError as error:
        raise ParameterError(
            f"--focus-at: expected two whole numbers X,Y of a pixel, got {focus_at!r}"
        ) from error
    if not (0 <= x < width and 0 <= y < height):
        raise ParameterError(
            f"--focus-at: expected a pixel inside the picture of {width}x{height}, got {focus_at}"
        )
    return float(values[y, x])


def _relative_defocus(values: "np.ndarray", blur: float, focus: float | None) -> "np.ndarray":
    """Defocus of relative disparity, sharp at ``focus``."""
    import numpy as np

    from bokehnet.checks import check_at_least
    from bokehnet.optics.coc import defocus_from_disparity

    check_at_least("--blur", blur, 0)
    assert focus is not None
    if not 0 <= focus <= 1:
        raise ParameterError(f"--focus: expected a relative disparity in 0..1, got {focus:g}")
    with np.errstate(over="ignore"):  # a blur beyond float32 is told by the renderer's check
        defocus: np.ndarray = defocus_from_disparity(values, blur, focus)
    return defocus


def _metric_defocus(
    disparity: "np.ndarray", metric: dict[str, float | None], chosen: float | None, width: int
) -> "np.ndarray":
    """Defocus of inverse depth in 1/mm, sharp at ``chosen`` (1/mm) or at ``--focus-distance`` (metres)."""
    from bokehnet.checks import check_number
    from bokehnet.lenses import ThinLens, defocus_map

    focal_length, f_number, focus_distance, sensor_width = metric.values()
    assert focal_length is not None
    assert f_number is not None
    assert sensor_width is not None
    check_number("--sensor-width", sensor_width)
    if sensor_width <= 0:
        raise ParameterError(f"--sensor-width: expected mm above 0, got {sensor_width:g}")
    if chosen is None:
        assert focus_distance is not None
        focus = 1000 * focus_distance
    else:
        focus = 1 / chosen if chosen > 0 else math.inf
    lens = ThinLens(focal_length=focal_length, f_number=f_number, focus_distance=focus)
    defocus: np.ndarray = defocus_map(disparity, lens, sensor_width / width)
    return defocus
