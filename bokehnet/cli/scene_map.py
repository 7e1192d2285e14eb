"""The map of a scene: from a file of disparity or depth, or from the photo itself."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.checks import check_choice
from bokehnet.cli.focus import Focus
from bokehnet.cli.frames import frame_path, is_pattern
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.io.camera import Camera
    from bokehnet.io.window import Window

__all__ = ["MapSource", "SceneMap"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneMap:
    """Disparity of a picture, and what its file says of the camera.

    Attributes:
        disparity: (H, W), 1/mm if ``metric``, else relative, near is large.
        metric: Whether distances are known.
        source: What it came from, for messages.
        window: Where its pixels lie in the shown picture, whose width that of the sensor spans.
        camera: What the files say; None where they say nothing.
        focus: Value of the map that stays sharp when nothing else is said; None where that must be said.
    """

    disparity: "np.ndarray"
    metric: bool
    source: str
    window: "Window"
    camera: "Camera | None" = None
    focus: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class MapSource:
    """Options that say where the map comes from and what is done with it.

    Attributes:
        disparity: File with relative disparity.
        depth: File with metric depth. With neither of them the photo's own map is taken.
        channel: Channel of the map in its file.
        unit: Of ``depth``.
        invert: Whether far is bright in ``disparity``.
        value_range: Values of ``disparity`` that become 0 and 1; None takes the lowest and the highest, and
            for the maps of a sequence, which must be treated alike, 0 and 1.
        as_stored: Whether that is so: ``disparity`` is one map of a sequence.
        mixed: Whether values between two surfaces at an edge are repaired, "auto", "on" or "off".
        resize: Whether a map of another size is brought to the picture's.
        refine: Whether its edges are moved to the picture's, one of ``REPAIR_MODES``.
    """

    disparity: Path | None = None
    depth: Path | None = None
    channel: str | None = None
    unit: str | None = None
    invert: bool = False
    value_range: tuple[float, float] | None = None
    as_stored: bool = False
    mixed: str = "auto"
    resize: bool = False
    refine: str = "auto"

    @property
    def files(self) -> list[Path]:
        """The files beside the picture."""
        return [path for path in (self.disparity, self.depth) if path is not None]

    def at(self, frame: int) -> "MapSource":
        """Return the source of one frame of a sequence, by the numbers in the names of the files."""
        return replace(
            self,
            disparity=self.disparity and frame_path(self.disparity, frame),
            depth=self.depth and frame_path(self.depth, frame),
            as_stored=self.disparity is not None and is_pattern(self.disparity),
        )

    def is_metric(self, blur_given: bool) -> bool:
        """Whether distances are known; a photo's own map can be either, and ``--blur`` makes it relative."""
        return self.depth is not None or (self.disparity is None and not blur_given)

    def check(self, focus: Focus) -> None:
        """Raise ``ParameterError`` unless these options fit together, and ``focus`` to them."""
        from bokehnet.inference.disparity_repair import REPAIR_MODES
        from bokehnet.io.maps import DEPTH_UNITS

        check_choice("--refine-disparity", self.refine, REPAIR_MODES)
        check_choice("--mixed-depth", self.mixed, REPAIR_MODES)
        if self.disparity is not None and self.depth is not None:
            raise ParameterError("expected one of --disparity and --depth, found both")
        if self.disparity is None and (self.invert or self.value_range is not None):
            raise ParameterError("--invert and --disparity-range need --disparity")
        if self.unit is not None:
            if self.depth is None:
                raise ParameterError("--depth-unit needs --depth")
            check_choice("--depth-unit", self.unit, DEPTH_UNITS)
        if not self.files and self.channel is not None:
            raise ParameterError("--channel needs --disparity or --depth")
        if self.value_range is not None and self.value_range[0] == self.value_range[1]:
            raise ParameterError("--disparity-range: expected two different numbers")
        if self.disparity is not None:
            focus.check(False, "--disparity", complete=True)
        elif self.depth is not None:
            focus.check(True, "--depth")
        elif focus.blur is not None:
            focus.check(False, "--blur")
        else:
            focus.check(True, "a photo's own depth (no --disparity, --depth or --blur is given)")
