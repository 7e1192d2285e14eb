"""BokehMe as published: its scatter alone, and the whole with both networks.

The scatter spreads soft discs weighted by their area, without occlusion. Its faults: foreground and
background mix without order; discs grow by half a pixel; lights behind a sharp edge shine through it. The
whole replaces it by a neural render near depth discontinuities. The networks are trained by
``configs/recipe_bokehme.toml``, not by the authors; ``docs/method/bokehme.md`` lists what is known.
"""

import math
from functools import lru_cache

import numpy as np

from bokehnet.baselines.apertures import check_baseline
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.checks import check_range
from bokehnet.inference.bokehme import DISPLAY_GAMMA, GAMMA_RANGE, highlight_gain, render_bokehme
from bokehnet.inference.session import WEIGHTS, OnnxNetwork, load_network
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["bokehme", "bokehme_scatter"]


@njit(cache=True)
def _scatter(light, defocus, sums, weights):
    height, width, _ = light.shape
    for y in range(height):
        for x in range(width):
            radius = abs(defocus[y, x])
            reach = int(radius + 1.0)
            for v in range(max(0, y - reach), min(height, y + reach + 1)):
                for u in range(max(0, x - reach), min(width, x + reach + 1)):
                    distance = math.sqrt((u - x) * (u - x) + (v - y) * (v - y))
                    weight = (0.5 + 0.5 * math.tanh(4.0 * (radius - distance))) / (radius * radius + 0.2)
                    weights[v, u] += weight
                    for c in range(3):
                        sums[v, u, c] += weight * light[y, x, c]


def bokehme_scatter(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, gamma: float = 1.0
) -> np.ndarray:
    """Render by the published scatter.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: Plain disc or None.
        gamma: Exponent of scene-linear light for blending, 0.2 to 5; that of the paper, for encoded light, is
            2.2 times as large.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    check_range("gamma", gamma, 0.2, 5)
    image, defocus, _ = check_baseline("bokehme_scatter", "disc", image, defocus, aperture)
    light = image if gamma == 1 else np.maximum(image, 0) ** np.float32(gamma)
    sums, weights = np.zeros(light.shape), np.zeros(defocus.shape)
    _scatter(light, defocus, sums, weights)
    bokeh = normalised(sums, weights, light)
    return bokeh if gamma == 1 else np.maximum(bokeh, 0) ** np.float32(1 / gamma)


@lru_cache(maxsize=1)
def _networks() -> tuple[OnnxNetwork, OnnxNetwork]:
    folder = WEIGHTS / "bokehme"
    arnet = load_network(folder, "bokehme_arnet", ("image", "defocus", "gamma"))
    return arnet, load_network(folder, "bokehme_iunet", ("image", "defocus", "coarse", "gamma"))


def bokehme(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    gamma: float = DISPLAY_GAMMA,
    highlight: bool = False,
) -> np.ndarray:
    """Render by BokehMe: the scatter, and near depth discontinuities ARNet and IUNet.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: Plain disc or None.
        gamma: Exponent of the paper, from encoded pictures to the light that is blended, 1 to 5; 2.2 blends
            scene-linear light.
        highlight: Whether to raise blurred highlights, see
            :func:`bokehnet.inference.bokehme.highlight_gain`.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ModelFileError: The networks are missing or damaged.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    check_range("gamma", gamma, *GAMMA_RANGE)
    image, defocus, _ = check_baseline("bokehme", "disc", image, defocus, aperture)
    arnet, iunet = _networks()
    encoded = np.maximum(image, 0).transpose(2, 0, 1) ** np.float32(1 / DISPLAY_GAMMA)
    if highlight:
        encoded = encoded * highlight_gain(encoded, defocus)
    light = np.ascontiguousarray(encoded.transpose(1, 2, 0)) ** np.float32(gamma)
    classical = bokehme_scatter(light, defocus).transpose(2, 0, 1) ** np.float32(1 / gamma)
    result = render_bokehme(
        encoded[None],
        defocus[None, None],
        classical[None],
        np.full((1, 1, 1, 1), gamma, np.float32),
        arnet=arnet,
        iunet=iunet,
    )
    bokeh = result.bokeh[0].transpose(1, 2, 0).clip(min=0) ** np.float32(DISPLAY_GAMMA)
    return np.ascontiguousarray(bokeh, np.float32)
