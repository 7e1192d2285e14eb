"""What all frames of a shot have in common, and the renderer made of it."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.cli.engine_option import RAY_ENGINES
from bokehnet.cli.memory_option import PROGRAM
from bokehnet.cli.naming import named_options
from bokehnet.effects import CameraEffects, View
from bokehnet.inference.disparity_repair import DisparityRepair
from bokehnet.inference.pipeline import BokehRenderer, RenderResult
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.lens_response import LensResponse
from bokehnet.optics.tone import Highlights

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.io.window import Window
    from bokehnet.optics.aberration_map import AberrationMap

__all__ = ["Look", "Renderer"]

_OPTIONS = {
    "gamma": "--gamma",
    "engine": "--engine",
    "max_memory": "--max-memory",
    "focus plane": "--focus-plane, --tilt-x, --tilt-y",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """How blur looks; see :class:`bokehnet.BokehRenderer` for each."""

    engine: str
    aperture: Aperture = field(default_factory=Aperture)
    character: LensResponse = field(default_factory=LensResponse)
    weights: Path | None = None
    gamma: float = 1.0
    highlights: Highlights | None = None
    effects: CameraEffects | None = None
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
            look.engine,
            aperture=look.aperture,
            lens_response=look.character,
            weights=look.weights,
            threads=threads,
        )
        self._refiner: DisparityRepair | None = None

    def render(
        self,
        image: "np.ndarray",
        defocus: "np.ndarray",
        report: Callable[[int, int], None] | None = None,
        *,
        pencil: "AberrationMap | None" = None,
        taken: int = 0,
    ) -> RenderResult:
        """Render a picture; where memory is bounded, the result takes the place of image and defocus.

        Args:
            image: (H, W, 3), scene-linear.
            defocus: (H, W), pixels; kept if it is not writable.
            report: Called with (steps done, steps in all).
            pencil: This picture's own.
            taken: Bytes of other pictures that are held meanwhile.
        """
        look = self._look
        kept = 0 if defocus.flags.writeable else defocus.nbytes
        with named_options(_OPTIONS):
            return self._through(pencil).render(
                image,
                defocus,
                report,
                gamma=look.gamma,
                highlights=look.highlights,
                max_memory=look.max_memory,
                memory_taken=PROGRAM + image.nbytes + defocus.nbytes + kept + taken,
                overwrite=look.max_memory is not None,
            )

    def render_alpha(
        self,
        alpha: "np.ndarray",
        defocus: "np.ndarray",
        *,
        pencil: "AberrationMap | None" = None,
        taken: int = 0,
    ) -> "np.ndarray":
        """Spread the coverage (H, W) as the same engine spreads the light of a grey picture.

        Arguments are those of :meth:`render`; nothing is written over.
        """
        import numpy as np

        grey = np.repeat(alpha[..., None], 3, axis=-1)
        held = PROGRAM + alpha.nbytes + 2 * defocus.nbytes + 2 * grey.nbytes + taken
        with named_options(_OPTIONS):
            spread = (
                self._through(pencil)
                .render(grey, defocus, max_memory=self._look.max_memory, memory_taken=held)
                .bokeh
            )
        coverage: np.ndarray = np.clip(spread.mean(axis=-1), 0, 1)
        return coverage

    def _through(self, pencil: "AberrationMap | None") -> BokehRenderer:
        """The renderer, with ``pencil`` added to its lens if its engine follows rays."""
        if pencil is None or self._look.engine not in RAY_ENGINES:
            return self._bokeh
        renderer, character = copy(self._bokeh), self._bokeh.lens_response
        renderer.lens_response = replace(character, aberration_map=character.aberration_map + pencil)
        return renderer

    def take(
        self, bokeh: "np.ndarray", alpha: "np.ndarray | None", window: "Window", frame: int
    ) -> "tuple[np.ndarray, np.ndarray | None]":
        """Return light (H, W, 3) and coverage (H, W) as the camera takes them, after its effects.

        Args:
            bokeh: The blurred picture, premultiplied where there is alpha.
            alpha: Its coverage, or None.
            window: Where its pixels lie in the shown picture.
            frame: Number of the frame.
        """
        import numpy as np

        effects = self._look.effects
        if effects is None:
            return bokeh, alpha
        view = View(width=window.display_width, height=window.display_height, left=window.x, top=window.y)
        picture = bokeh if alpha is None else np.dstack([bokeh, alpha])
        with named_options({"distortion": "--distortion-brown"}):  # --distortion never folds
            taken = effects.apply(picture, view=view, frame=frame)
        return taken[..., :3], None if alpha is None else taken[..., 3]

    def refine(self, image: "np.ndarray", disparity: "np.ndarray", mode: str) -> "np.ndarray":
        """Move the edges of a map (H, W) to those of the picture; ``mode`` is one of ``REPAIR_MODES``."""
        if mode == "off":
            return disparity
        if self._refiner is None:
            self._refiner = DisparityRepair(threads=self._threads)
        return self._refiner(image, disparity, mode)
