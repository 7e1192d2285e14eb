"""The renderer that people use: picture and defocus in, bokeh out, without torch."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bokehnet.cascade import render_neural
from bokehnet.checks import check_choice
from bokehnet.classical.base import CLASSICAL_RENDERERS, ClassicalResult, check_inputs, make_classical
from bokehnet.errors import ParameterError
from bokehnet.fusion import fuse
from bokehnet.inference.session import WEIGHTS, load_networks
from bokehnet.inference.tiling import refine_in_tiles
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.tone import Highlights, gamma_curve

__all__ = ["ENGINES", "BokehRenderer", "RenderResult"]

# Engines with networks: the best, on the rays, and a faster one on the scatter.
HYBRIDS = ("hybrid", "fast")

# Classical renderers are engines of their own.
ENGINES = (*HYBRIDS, *CLASSICAL_RENDERERS)

Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderResult:
    """A rendered picture and what it was made of; all scene-linear float32.

    Attributes:
        bokeh: The result, (H, W, 3).
        classical: The classical half, (H, W, 3).
        neural: The neural half, (H, W, 3); ``None`` for a classical engine.
        error_map: The blend, (H, W) in [0, 1], 1 = neural: the learned map within the reach of a depth
            discontinuity, 0 elsewhere; for a classical engine, where it can be wrong.
    """

    bokeh: np.ndarray
    classical: np.ndarray
    neural: np.ndarray | None
    error_map: np.ndarray


def _to_batch(array: np.ndarray) -> np.ndarray:
    """(H, W, C) or (H, W) to (1, C, H, W)."""
    return array[None, None] if array.ndim == 2 else np.ascontiguousarray(array.transpose(2, 0, 1))[None]


class BokehRenderer:
    """Renders bokeh on the CPU.

    Args:
        engine: One of ``ENGINES``.
        aperture: Shape of the lens opening; default a plain disc. Networks were trained on discs; with other
            shapes they correct what the classical half made of them.
        weights: Folder with the networks and their manifest; the package's own by default.
        threads: Threads inside a network; 0 takes all cores.

    Raises:
        ParameterError: Unknown engine.
        ModelFileError: The engine needs networks, and they are missing or damaged.
    """

    def __init__(
        self,
        engine: str = "rays",
        *,
        aperture: Aperture | None = None,
        weights: Path | None = None,
        threads: int = 0,
    ) -> None:
        check_choice("engine", engine, ENGINES)
        self.engine = engine
        self.aperture = aperture or Aperture()
        neural = engine in HYBRIDS
        self._networks = load_networks(weights or WEIGHTS / engine, threads) if neural else None
        self._classical_name = self._networks.classical if self._networks else engine
        self._classical = make_classical(self._classical_name)

    def render(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        progress: Progress | None = None,
        *,
        gamma: float = 1.0,
        highlights: Highlights | None = None,
    ) -> RenderResult:
        """Render one picture.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3). Values below 0 count as 0.
            defocus: Signed blur radius in pixels, (H, W), positive in front of focus; see
                :func:`bokehnet.optics.coc.defocus_from_disparity` and :func:`bokehnet.lenses.defocus_map`.
            progress: Called with (steps done, steps in all).
            gamma: Above 1 bright pixels prevail where light mixes, 0.2 to 5; 1 is a real lens. See
                :func:`bokehnet.optics.tone.gamma_curve`.
            highlights: How clipped lights get their brightness back before blurring. The result keeps
                it, unclipped; :meth:`Highlights.compress` brings it back to the range of the photograph.

        Raises:
            ShapeError: Not (H, W, 3) and (H, W) of one size.
            ParameterError: NaN or infinity in either; gamma out of range, or not 1 with the hybrid.
        """
        image, defocus = (x.astype(np.float32, copy=False) for x in check_inputs(image, defocus))
        image = np.maximum(image, 0)
        if self._networks is not None and gamma != 1:
            raise ParameterError(
                f"gamma: expected 1, all that the networks of {self.engine} know, got {gamma:g}; "
                f"use --engine {self._classical_name}"
            )
        if highlights is not None:
            image = highlights.expand(image)
        report = progress or (lambda done, total: None)
        steps = 1 if self._networks is None else 2
        report(0, steps)
        result = self._render_classical(image, defocus, gamma)
        report(1, steps)
        if self._networks is None:
            return RenderResult(
                bokeh=result.bokeh, classical=result.bokeh, neural=None, error_map=result.error_map
            )
        neural, error_map = self._render_neural(image, defocus, result)
        report(2, steps)
        bokeh = fuse(result.bokeh, neural, error_map[..., None])
        return RenderResult(bokeh=bokeh, classical=result.bokeh, neural=neural, error_map=error_map)

    def _render_classical(self, image: np.ndarray, defocus: np.ndarray, gamma: float) -> ClassicalResult:
        if gamma == 1:
            return self._classical(image, defocus, self.aperture)
        curve = gamma_curve(image, gamma)
        result = self._classical(curve.encode(image), defocus, self.aperture)
        return replace(result, bokeh=curve.decode(result.bokeh))

    def _render_neural(
        self, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the neural half (H, W, 3) and the error map (H, W)."""
        assert self._networks is not None
        batches = [_to_batch(x) for x in (image, defocus, classical.bokeh, classical.error_map)]
        result = render_neural(
            *batches,
            hints=None if classical.hints is None else _to_batch(classical.hints),
            arnet=self._networks.arnet,
            iunet=self._networks.iunet,
            unit=self._networks.unit,
            refine=refine_in_tiles,
        )
        return np.ascontiguousarray(result.steps[-1][0].transpose(1, 2, 0)), result.error_map[0, 0]
