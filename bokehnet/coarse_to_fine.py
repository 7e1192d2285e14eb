"""The neural half from coarse to fine: ARNet where the blur is small, then up to full size.

The way up is IUNet's, level by level. Without it ARNet's change of the classical render is doubled until it
has the picture's size, and laid over: detail is the classical render's. A scatter's detail is not to be
trusted everywhere: see :func:`suppress_foreground_outlines`.

The formulas, :func:`ask_arnet`, :func:`find_change`, :func:`lay_over`, :func:`suppress_foreground_outlines`
and :func:`bokehnet.fusion.fuse`, are written once, on operators: for training (torch), for inference (NumPy)
and for the one file (ONNX graphs).
:func:`render_neural` is the whole way for torch and NumPy. Two twins go it in their own fashion:
:mod:`bokehnet.engines.coarse_to_fine`, without an IUNet, in strips and only where the classical render can
be wrong, and :mod:`bokehnet.onnx_file.neural` with the loops of a graph.
``tests/reference/test_correction_agrees.py`` holds all of them to one result.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from bokehnet.arrays.pyramid import count_halvings, crop_to, downsample2, pad_to_multiple, upsample2
from bokehnet.checks import Array, array_namespace
from bokehnet.fusion import fuse
from bokehnet.optics.encoding import decode, encode

__all__ = [
    "CoarseNetwork",
    "Level",
    "NeuralResult",
    "Refine",
    "RefineNetwork",
    "ask_arnet",
    "build_levels",
    "find_change",
    "lay_over",
    "refine_whole",
    "render_neural",
    "suppress_foreground_outlines",
]

# Blur in front of focus, in pixels of the coarse size, from which on no detail of such a render is kept.
_DETAIL_ENDS = 3.0

# And from which on the root of the error map takes its place.
_FAR = 9.0


class CoarseNetwork(Protocol):
    """ARNet, as a torch module, an ONNX session, or nodes of an ONNX graph."""

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
    """The neural half of the hybrid, and the blend of both.

    Attributes:
        bokeh: The blend, (B, 3, H, W), at the picture's size. Where the error map is 0 it is the classical
            render bit for bit.
        steps: Bokeh (B, 3, h, w) at every level, coarse to fine; without an IUNet at the first one only.
        picture: The networks' own, (B, 3, H, W): ARNet's change laid over the classical render; with an IUNet
            the mean of that, which has all detail, and of IUNet's last step, which relies on none.
        error_map: (B, 1, H, W) in [0, 1], at the picture's size: ARNet's times the classical renderer's, so
            that nothing changes where the classical render is right.
    """

    bokeh: Array
    steps: list[Array]
    picture: Array
    error_map: Array


# Sides of the coarsest level are multiples of this: a U-Net halves its input three times.
BLOCK = 8

# How IUNet is run at one level: (network, level, bokeh at half the size, error map) to bokeh (B, 3, H, W).
# The error map (B, 1, H, W) tells where the result will be used.
Refine = Callable[[RefineNetwork, Level, Array, Array], Array]


def ask_arnet(
    arnet: CoarseNetwork,
    image: Array,
    defocus: Array,
    classical: Array,
    features: Array | None,
    max_valid_radius: Array,
) -> tuple[Array, Array]:
    """Run ARNet at the coarse size.

    Args:
        arnet: The network.
        image: See :class:`Level`, as ``defocus``, ``classical`` and ``features``.
        defocus: See ``image``.
        classical: See ``image``.
        features: See ``image``.
        max_valid_radius: Largest blur radius, in pixels of this size, that ARNet learned from. The error map
            fades out over the upper half of that range, to 0 at its end.

    Returns:
        Bokeh (B, 3, h, w), scene-linear, and error map (B, 1, h, w) in [0, 1].
    """
    bokeh, error_map = arnet(image, defocus, classical, features)
    return bokeh, error_map * (2 - 2 * abs(defocus) / max_valid_radius).clip(0, 1)


def find_change(bokeh: Array, classical: Array) -> Array:
    """How a bokeh differs from the classical render, on a scale on which light and shadow weigh alike."""
    return encode(bokeh) - encode(classical)


def lay_over(classical: Array, change: Array) -> Array:
    """Change the classical render at full size; the inverse of :func:`find_change`.

    Args:
        classical: Scene-linear.
        change: Of its encoded colours, from a coarse size; of the same shape.

    Returns:
        Bokeh, scene-linear. Where nothing changes it equals ``classical``, up to rounding.
    """
    return decode(encode(classical) + change).clip(min=0)


def suppress_foreground_outlines(
    classical: Array, defocus: Array, coarse: Array, coarse_defocus: Array, error_map: Array
) -> tuple[Array, Array]:
    """Rely less on a scatter where something stands before focus and the network doubts the render.

    No detail there is finer than the blur, but a scatter does not know what a foreground hides, and keeps its
    outline. At the coarse size the same render has the same light without the line. And the farther before
    focus, the more a doubt counts.

    Args:
        classical: Scene-linear.
        defocus: Signed radius in pixels of the coarse size.
        coarse: ``classical`` as it is at the coarse size, doubled up to full size.
        coarse_defocus: The same of ``defocus``: an outline has two sides, and that of the background is a
            coarse pixel wide.
        error_map: Where the render is wrong, in [0, 1].

    Returns:
        Both, mended. Where the error map is 0, and away from what stands before focus, bit for bit as before.
    """
    radius = array_namespace(defocus).maximum(defocus, coarse_defocus)
    doubt = (2 * error_map).clip(0, 1)
    mended = fuse(classical, coarse, (radius / _DETAIL_ENDS).clip(0, 1) * doubt)
    far = ((radius - _DETAIL_ENDS) / (_FAR - _DETAIL_ENDS)).clip(0, 1)
    return mended, fuse(error_map, error_map**0.5, far)


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
    network_max_radius: float,
    iunet: RefineNetwork | None = None,
    max_valid_radius: float = math.inf,
    refine: Refine = refine_whole,
    features: Array | None = None,
    extra_halvings: int = 0,
    leaves_outlines: bool = False,
) -> NeuralResult:
    """Render the neural half, and blend.

    The published method resizes by max|r| over the radius that ARNet was trained for; here the factor is the
    next power of two, so that every step doubles exactly, no step loses detail, and pixels of all sizes are
    aligned.

    Args:
        image: All-in-focus picture, scene-linear, (B, 3, H, W).
        defocus: Signed blur radius in pixels, (B, 1, H, W).
        classical: Classical render, scene-linear, (B, 3, H, W).
        classical_error_map: The classical renderer's own error map, (B, 1, H, W) in [0, 1].
        arnet: The coarse network.
        network_max_radius: Largest radius ``arnet`` was trained for, pixels.
        iunet: The refining network; without it ARNet's change is laid over the classical render.
        max_valid_radius: Largest blur radius that the networks may correct, in pixels of the picture.
        refine: How IUNet is run at each level.
        features: What the classical renderer knows besides, see :class:`Level`.
        extra_halvings: Start this many sizes lower than needed (for training).
        leaves_outlines: Whether the classical renderer leaves sharp outlines on blurred foregrounds
            (:attr:`~bokehnet.engine_registry.EngineSpec.sharp_foregrounds`).

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    height, width = image.shape[-2:]
    halvings = count_halvings(float(abs(defocus).max()), network_max_radius) + extra_halvings
    levels = build_levels(image, defocus, classical, classical_error_map, features, halvings)
    low, full = levels[0], levels[-1]
    bokeh, learned = ask_arnet(
        arnet, low.image, low.defocus, low.classical, low.features, max_valid_radius / 2**halvings
    )
    steps = [bokeh]
    change, light, radius = find_change(bokeh, low.classical), low.classical, low.defocus
    for level in levels[1:]:
        learned, change = upsample2(learned), upsample2(change)
        if leaves_outlines:
            light, radius = upsample2(light), upsample2(radius)
        if iunet is not None:
            steps.append(refine(iunet, level, steps[-1], learned * level.classical_error_map))
    error_map, classical = learned * full.classical_error_map, full.classical
    if leaves_outlines:
        at_full_size = full.defocus / 2**halvings
        classical, error_map = suppress_foreground_outlines(classical, at_full_size, light, radius, error_map)
    picture = lay_over(classical, change)
    if iunet is not None:
        picture = 0.5 * (picture + steps[-1])
        steps[-1] = crop_to(steps[-1], height, width)
    found = (fuse(classical, picture, error_map), picture, error_map)
    bokeh, picture, error_map = (crop_to(x, height, width) for x in found)
    return NeuralResult(bokeh=bokeh, steps=steps, picture=picture, error_map=error_map)
