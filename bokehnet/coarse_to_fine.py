"""The neural half from coarse to fine: ARNet where the blur is small, then up to full size.

The way up is IUNet's, or, without it, :func:`carry_detail`.

One body for training (torch modules on tensors) and for inference (ONNX sessions on NumPy arrays).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from bokehnet.checks import Array, array_namespace
from bokehnet.optics.encoding import decode, encode
from bokehnet.pyramid import count_halvings, crop_to, downsample2, pad_to_multiple, upsample2

__all__ = [
    "CoarseNetwork",
    "Level",
    "NeuralResult",
    "Refine",
    "RefineNetwork",
    "build_levels",
    "carry_detail",
    "refine_whole",
    "render_neural",
]


class CoarseNetwork(Protocol):
    """ARNet, as a torch module or an ONNX session."""

    def __call__(
        self, image: Array, defocus: Array, classical: Array, features: Array | None, /
    ) -> tuple[Array, Array]:
        """Return bokeh (B, 3, H, W) and error map (B, 1, H, W) for blur that it was trained for."""
        ...


class RefineNetwork(Protocol):
    """IUNet, as a torch module or an ONNX session."""

    def __call__(
        self, image: Array, defocus: Array, classical: Array, coarse: Array, features: Array | None, /
    ) -> Array:
        """Return bokeh (B, 3, H, W), given ``coarse``, the bokeh at half the size."""
        ...


@dataclass(frozen=True, slots=True)
class Level:
    """The inputs at one size.

    Attributes:
        image, classical: Scene-linear, (B, 3, H, W).
        defocus: Signed radius in pixels of this size, (B, 1, H, W).
        classical_error_map: Where the classical render can be wrong, (B, 1, H, W) in [0, 1].
        features: What the classical renderer knows besides, (B, 5, H, W): the colours that it takes to stand
            behind each pixel, scene-linear, the share of the pixel's light that no picture shows, and the
            classical error map; ``None`` if it knows nothing.
    """

    image: Array
    defocus: Array
    classical: Array
    classical_error_map: Array
    features: Array | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class NeuralResult:
    """The neural half of the hybrid.

    Attributes:
        steps: Bokeh (B, 3, h, w) at every level, coarse to fine; the last has the picture's size.
        error_map: (B, 1, H, W) in [0, 1], at the picture's size: ARNet's times the classical renderer's, so
            that nothing changes where the classical render is right.
    """

    steps: list[Array]
    error_map: Array


# Sides of the coarsest level are multiples of this: a U-Net halves its input three times.
BLOCK = 8

# How IUNet is run at one level: (network, level, bokeh at half the size, error map) to bokeh (B, 3, H, W).
# The error map (B, 1, H, W) tells where the result will be used.
Refine = Callable[[RefineNetwork, Level, Array, Array], Array]


def carry_detail(
    image: Array, defocus: Array, classical: Array, coarse: Array, features: Array | None
) -> Array:
    """Stand in for IUNet: what is finer than ``coarse`` is taken over from the classical render.

    Both are compared on a perceptual scale, so that a correction means the same in light and in shadow.

    Args:
        image: Not looked at, as ``defocus`` and ``features``.
        defocus: See ``image``.
        classical: Scene-linear, (B, 3, H, W), sides even.
        coarse: Bokeh at half the size, (B, 3, H/2, W/2).
        features: See ``image``.

    Returns:
        Bokeh (B, 3, H, W). Where ``coarse`` equals the halved classical render, so does this at full size.
    """
    correction = upsample2(encode(coarse) - encode(downsample2(classical)))
    return decode(encode(classical) + correction).clip(min=0)


def refine_whole(iunet: RefineNetwork, level: Level, coarse: Array, error_map: Array) -> Array:
    """Run IUNet on the whole picture at once."""
    return iunet(level.image, level.defocus, level.classical, coarse, level.features)


def build_levels(
    image: Array,
    defocus: Array,
    classical: Array,
    classical_error_map: Array,
    features: Array | None,
    halvings: int,
) -> list[Level]:
    """Halve the inputs ``halvings`` times; coarse to fine. The coarsest sides are multiples of ``BLOCK``."""
    arrays = [image, defocus, classical, classical_error_map, *([] if features is None else [features])]
    arrays = [pad_to_multiple(x, BLOCK * 2**halvings) for x in arrays]
    levels = [Level(*arrays)]
    for _ in range(halvings):
        smaller = [downsample2(x) for x in arrays]
        smaller[1] = 0.5 * smaller[1]
        arrays = smaller
        levels.insert(0, Level(*arrays))
    return levels


def render_neural(
    image: Array,
    defocus: Array,
    classical: Array,
    classical_error_map: Array,
    *,
    arnet: CoarseNetwork,
    iunet: RefineNetwork,
    network_max_radius: float,
    refine: Refine = refine_whole,
    features: Array | None = None,
    extra_halvings: int = 0,
) -> NeuralResult:
    """Render the neural half.

    The published method resizes by max|r| over the radius that ARNet was trained for; here the factor is the
    next power of two, so that every step doubles exactly, no step loses detail, and pixels of all sizes are
    aligned.

    Args:
        image: All-in-focus picture, scene-linear, (B, 3, H, W).
        defocus: Signed blur radius in pixels, (B, 1, H, W).
        classical: Classical render, scene-linear, (B, 3, H, W).
        classical_error_map: The classical renderer's own error map, (B, 1, H, W) in [0, 1].
        arnet: The coarse network.
        iunet: The refining network, or :func:`carry_detail`.
        network_max_radius: Largest radius ``arnet`` was trained for, pixels.
        refine: How IUNet is run at each level.
        features: What the classical renderer knows besides, see :class:`Level`.
        extra_halvings: Start this many sizes lower than needed (for training).

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    height, width = image.shape[-2:]
    largest = float(array_namespace(defocus).abs(defocus).max())
    halvings = count_halvings(largest, network_max_radius) + extra_halvings
    levels = build_levels(image, defocus, classical, classical_error_map, features, halvings)
    bokeh, learned = arnet(levels[0].image, levels[0].defocus, levels[0].classical, levels[0].features)
    steps = [bokeh]
    for level in levels[1:]:
        learned = upsample2(learned)
        steps.append(refine(iunet, level, steps[-1], learned * level.classical_error_map))
    steps[-1] = crop_to(steps[-1], height, width)
    return NeuralResult(
        steps=steps, error_map=crop_to(learned * levels[-1].classical_error_map, height, width)
    )
