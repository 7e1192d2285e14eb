"""What all frames of a shot have in common, and the renderer made of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.cli.naming import named_options
from bokehnet.inference.pipeline import BokehRenderer, RenderResult
from bokehnet.inference.refine import DisparityRefiner
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.tone import Highlights

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Look", "Renderer"]

_OPTIONS = {"gamma": "--gamma", "engine": "--engine", "max_memory": "--max-memory"}


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """How blur looks; see :class:`bokehnet.BokehRenderer` for each."""

    engine: str
    aperture: Aperture = field(default_factory=Aperture)
    weights: Path | None = None
    gamma: float = 1.0
    highlights: Highlights | None = None
    max_memory: int | None = None


class Renderer:
    """A renderer with its options, made once for many frames.

    Args:
        look: How blur looks.
        threads: Threads inside a network; 0 takes all cores.

    Raises:
        BokehnetError: As :class:`bokehnet.BokehRenderer`.
    """

    def __init__(self, look: Look, threads: int = 0) -> None:
        self._look, self._threads = look, threads
        self._bokeh = BokehRenderer(
            look.engine, aperture=look.aperture, weights=look.weights, threads=threads
        )
        self._refiner: DisparityRefiner | None = None

    def render(
        self,
        image: "np.ndarray",
        defocus: "np.ndarray",
        report: Callable[[int, int], None] | None = None,
    ) -> RenderResult:
        """Render a picture (H, W, 3) with its defocus (H, W), pixels."""
        look = self._look
        with named_options(_OPTIONS):
            return self._bokeh.render(
                image,
                defocus,
                report,
                gamma=look.gamma,
                highlights=look.highlights,
                max_memory=look.max_memory,
            )

    def render_alpha(self, alpha: "np.ndarray", defocus: "np.ndarray") -> "np.ndarray":
        """Spread the coverage (H, W) as the same engine spreads the light of a grey picture."""
        import numpy as np

        grey = np.repeat(alpha[..., None], 3, axis=-1)
        spread = self._bokeh.render(grey, defocus, max_memory=self._look.max_memory).bokeh
        coverage: np.ndarray = np.clip(spread[..., 0], 0, 1)
        return coverage

    def refine(self, image: "np.ndarray", disparity: "np.ndarray", mode: str) -> "np.ndarray":
        """Move the edges of a map (H, W) to those of the picture; ``mode`` is one of ``REFINE_MODES``."""
        if mode == "off":
            return disparity
        if self._refiner is None:
            self._refiner = DisparityRefiner(threads=self._threads)
        return self._refiner(image, disparity, mode)
