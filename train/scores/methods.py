"""Methods to compare: an engine, its networks and an optional disparity repair."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numba
import numpy as np

from benchmarks.methods.classical_repair import guided, joint_bilateral
from bokehnet.checks import check_choice
from bokehnet.depth_repair.repair import DisparityRepair, RepairMode
from bokehnet.engine_registry import ENGINES
from bokehnet.optics.aperture import Aperture
from bokehnet.render.renderer import BokehRenderer
from bokehnet.render.result import RenderResult

__all__ = ["REPAIRS", "Method", "parse_method"]

# Names of repairs in earlier versions.
_OLD_REPAIR_NAMES = {"refine": "repair"}

# (image (H, W, 3) scene-linear, disparity (H, W) on any scale) -> disparity on the same scale
Repair = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True, slots=True)
class Method:
    """Parsed form of ``ENGINE[:FOLDER][+REPAIR]``; picklable.

    Attributes:
        name: Original text.
        engine: One of ``ENGINES``.
        weights: Folder of the engine's networks; default: those of the package.
        repair: One of ``REPAIRS``; default: none.
    """

    name: str
    engine: str
    weights: Path | None = None
    repair: str | None = None

    def load(self) -> None:
        """Load all networks, so that a missing file raises at once."""
        _renderer(self.engine, Aperture(), self.weights, numba.get_num_threads())

    def render(self, image: np.ndarray, defocus: np.ndarray, aperture: Aperture) -> RenderResult:
        """Render with defocus that has already been repaired."""
        return _renderer(self.engine, aperture, self.weights, numba.get_num_threads()).render_arrays(
            image, defocus
        )


def parse_method(text: str) -> Method:
    """Read ``ENGINE[:FOLDER][+REPAIR]``, as in ``hybrid:runs/best/weights+repair``.

    Raises:
        ParameterError: Unknown engine or repair.
    """
    base, plus, ending = text.rpartition("+")
    head, kind = (base, ending) if plus else (text, "")
    engine, _, weights = head.partition(":")
    check_choice("--method", engine, ENGINES)
    kind = _OLD_REPAIR_NAMES.get(kind, kind)
    if plus:
        check_choice("--method", kind, REPAIRS)
    return Method(
        name=text,
        engine=engine,
        weights=Path(weights) if weights else None,
        repair=kind if plus else None,
    )


@cache
def _renderer(engine: str, aperture: Aperture, weights: Path | None, threads: int) -> BokehRenderer:
    return BokehRenderer(engine, aperture=aperture, weights=weights, threads=threads)


def _disparity_repair(mode: RepairMode) -> Repair:
    return lambda image, disparity: DisparityRepair()(image, disparity, mode)


REPAIRS: dict[str, Repair] = {
    "repair": _disparity_repair("on"),
    "auto": _disparity_repair("auto"),
    "guided": guided,
    "bilateral": joint_bilateral,
}
