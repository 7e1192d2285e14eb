"""Neural half from coarse to fine: ARNet where the blur is small, then up to full size.

With IUNet the way up is level by level. Without it ARNet's change of the classical render is doubled to the
size of the picture, and applied: detail is that of the classical render. The detail of a scatter is wrong in
some places: see :func:`suppress_foreground_outlines`.

The formulas :func:`run_arnet`, :func:`encoded_change`, :func:`apply_change`,
:func:`suppress_foreground_outlines` and :func:`bokehnet.arrays.fusion.fuse` are written once, on operators:
for training (torch), for inference (NumPy) and for the one file (ONNX graphs).
:func:`render_neural` is the complete algorithm for torch and NumPy. Two variants exist:
:mod:`bokehnet.engines.coarse_to_fine`, without an IUNet, in strips and only where the classical render can
be wrong, and :mod:`bokehnet.onnx_file.neural` with the loops of a graph.
``tests/reference/test_correction_agrees.py`` checks that all agree.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from bokehnet.arrays.fusion import fuse
from bokehnet.arrays.pyramid import count_halvings, crop_to, downsample2, pad_to_multiple, upsample2
from bokehnet.checks import Array, array_namespace
from bokehnet.optics.encoding import decode, encode

__all__ = [
    "CoarseNetwork",
    "Level",
    "NeuralResult",
    "Refine",
    "RefineNetwork",
    "apply_change",
    "build_levels",
    "encoded_change",
    "refine_whole",
    "render_neural",
    "run_arnet",
    "suppress_foreground_outlines",
]

# Blur in front of focus, pixels of the coarse size, from which on the coarse render replaces all detail.
_MAX_DETAIL_BLUR_PX = 3.0

# Blur in front of focus from which on the root of the error map replaces it.
_MAX_BLUR_PX = 9.0


class CoarseNetwork(Protocol):
    """ARNet, as a torch module, an ONNX session, or nodes of an ONNX graph."""

    def __call__(
        self, image: Array, defocus: Array, classical: Array, features: Array | None, /
    ) -> tuple[Array, Array]:
        """Return bokeh (B, 3, H, W) and error map (B, 1, H, W) for blur within the range of the training."""
        ...


class RefineNetwork(Protocol):
    """IUNet, as a torch module or an ONNX session."""

    def __call__(
        self, image: Array, defocus: Array, classical: Array, coarse: Array, features: Array | None, /
    ) -> Array:
        """Return bokeh (B, 3, H, W) from ``coarse``, the bokeh at half the size."""
        ...


@dataclass(frozen=True, slots=True)
class Level:
    """Inputs at one size.

    Attributes:
        image, classical: Scene-linear, (B, 3, H, W).
        defocus: Signed blur radius in pixels of this size, (B, 1, H, W).
        classical_error_map: Error map of the classical render, (B, 1, H, W) in [0, 1].
        features: Further output of the classical renderer, (B, 5, H, W): colors of the occluded background,
            scene-linear, fraction of the pixel's light that no picture shows, and the classical error map;
            ``None`` if it has none.
    """

    image: Array
    defocus: Array
    classical: Array
    classical_error_map: Array
    features: Array | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class NeuralResult:
    """Neural half of the hybrid, and the blend of both halves.

    Attributes:
        bokeh: Blend, (B, 3, H, W), at the picture's size. Where the error map is 0 it is the classical
            render bit for bit.
        steps: Bokeh (B, 3, h, w) at every level, coarse to fine; without an IUNet at the first one only.
        picture: Picture of the networks, (B, 3, H, W): the classical render with ARNet's change; with an
            IUNet the mean of that, which has all detail, and of IUNet's last step, which does not depend on
            it.
        error_map: (B, 1, H, W) in [0, 1], at the picture's size: ARNet's times the classical renderer's, so
            that nothing changes where the classical render is right.
    """

    bokeh: Array
    steps: list[Array]
    picture: Array
    error_map: Array


# Sides of the coarsest level are multiples of this, pixels: a U-Net halves its input three times.
BLOCK = 8

# Runs IUNet at one level: (network, level, bokeh at half the size, error map) to bokeh (B, 3, H, W).
# The error map (B, 1, H, W) is above 0 where the result is used.
Refine = Callable[[RefineNetwork, Level, Array, Array], Array]


def run_arnet(
    arnet: CoarseNetwork,
    image: Array,
    defocus: Array,
    classical: Array,
    features: Array | None,
    max_valid_radius: Array,
) -> tuple[Array, Array]:
    """Run ARNet at the coarse size.

    Args:
        arnet: Coarse network.
        image: See :class:`Level`, as ``defocus``, ``classical`` and ``features``.
        defocus: See ``image``.
        classical: See ``image``.
        features: See ``image``.
        max_valid_radius: Largest blur radius in the training of ARNet, pixels of this size. The error map
            fades out over the upper half of that range, to 0 at its end.

    Returns:
        Bokeh (B, 3, h, w), scene-linear, and error map (B, 1, h, w) in [0, 1].
    """
    bokeh, error_map = arnet(image, defocus, classical, features)
    return bokeh, error_map * (2 - 2 * abs(defocus) / max_valid_radius).clip(0, 1)


def encoded_change(bokeh: Array, classical: Array) -> Array:
    """Return the difference of a bokeh and the classical render in encoded colors.

    The encoding gives light and shadow similar weight.
    """
    return encode(bokeh) - encode(classical)


def apply_change(classical: Array, change: Array) -> Array:
    """Apply a change to the classical render at full size; the inverse of :func:`encoded_change`.

    Args:
        classical: Classical render, scene-linear.
        change: Change of its encoded colors, from a coarse size; same shape.

    Returns:
        Bokeh, scene-linear. Where the change is 0 it equals ``classical``, up to rounding.
    """
    return decode(encode(classical) + change).clip(min=0)


def suppress_foreground_outlines(
    classical: Array, defocus: Array, coarse: Array, coarse_defocus: Array, error_map: Array
) -> tuple[Array, Array]:
    """Reduce the detail of a scatter in front of focus where the error map is above 0.

    No detail there is finer than the blur, but a scatter ignores occlusion by a foreground, and keeps its
    outline. At the coarse size the same render has the same light without the outline. The farther in front
    of focus, the more the error map is raised.

    Args:
        classical: Scatter, scene-linear.
        defocus: Signed blur radius in pixels of the coarse size.
        coarse: ``classical`` at the coarse size, doubled up to full size.
        coarse_defocus: ``defocus`` at the coarse size, doubled: an outline has two sides, and that of the
            background is a coarse pixel wide.
        error_map: Expected error of the scatter, in [0, 1].

    Returns:
        Both, corrected. Where the error map is 0, and behind focus, they are unchanged bit for bit.
    """
    radius = array_namespace(defocus).maximum(defocus, coarse_defocus)
    doubt = (2 * error_map).clip(0, 1)
    suppressed = fuse(classical, coarse, (radius / _MAX_DETAIL_BLUR_PX).clip(0, 1) * doubt)
    distance_weight = ((radius - _MAX_DETAIL_BLUR_PX) / (_MAX_BLUR_PX - _MAX_DETAIL_BLUR_PX)).clip(0, 1)
    return suppressed, fuse(error_map, error_map**0.5, distance_weight)


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

    The published method resizes by max|r| over the radius in the training of ARNet; here the factor is the
    next power of two, so that every step doubles exactly, no step loses detail, and pixels of all sizes are
    aligned.

    Args:
        image: All-in-focus picture, scene-linear, (B, 3, H, W).
        defocus: Signed blur radius in pixels, (B, 1, H, W).
        classical: Classical render, scene-linear, (B, 3, H, W).
        classical_error_map: The classical renderer's own error map, (B, 1, H, W) in [0, 1].
        arnet: Coarse network.
        network_max_radius: Largest radius in the training of ``arnet``, pixels.
        iunet: Refining network; without it ARNet's change is applied to the classical render.
        max_valid_radius: Largest blur radius that the networks may correct, in pixels of the picture.
        refine: Function that runs IUNet at each level.
        features: Further output of the classical renderer, see :class:`Level`.
        extra_halvings: Number of additional smaller sizes (for training).
        leaves_outlines: True if the classical renderer leaves sharp outlines on blurred foregrounds
            (:attr:`~bokehnet.engine_registry.EngineSpec.sharp_foregrounds`).

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    height, width = image.shape[-2:]
    halvings = count_halvings(float(abs(defocus).max()), network_max_radius) + extra_halvings
    levels = build_levels(image, defocus, classical, classical_error_map, features, halvings)
    low, full = levels[0], levels[-1]
    bokeh, learned = run_arnet(
        arnet, low.image, low.defocus, low.classical, low.features, max_valid_radius / 2**halvings
    )
    steps = [bokeh]
    change, light, radius = encoded_change(bokeh, low.classical), low.classical, low.defocus
    for level in levels[1:]:
        learned, change = upsample2(learned), upsample2(change)
        if leaves_outlines:
            light, radius = upsample2(light), upsample2(radius)
        if iunet is not None:
            steps.append(refine(iunet, level, steps[-1], learned * level.classical_error_map))
    error_map, classical = learned * full.classical_error_map, full.classical
    if leaves_outlines:
        radius_at_full_size = full.defocus / 2**halvings
        classical, error_map = suppress_foreground_outlines(
            classical, radius_at_full_size, light, radius, error_map
        )
    picture = apply_change(classical, change)
    if iunet is not None:
        picture = 0.5 * (picture + steps[-1])
        steps[-1] = crop_to(steps[-1], height, width)
    outputs = (fuse(classical, picture, error_map), picture, error_map)
    bokeh, picture, error_map = (crop_to(x, height, width) for x in outputs)
    return NeuralResult(bokeh=bokeh, steps=steps, picture=picture, error_map=error_map)
