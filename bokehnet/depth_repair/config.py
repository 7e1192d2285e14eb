"""Numbers of the depth repair.

``python -m benchmarks.quality.repair --ablate`` measures every stage, ``--harm`` the acceptance; figures in
the comments are theirs unless another source is named. Lengths are pixels of the size at which a stage runs.
"""

from dataclasses import dataclass

__all__ = [
    "BLOCK_PX",
    "COLOR_SIGMA",
    "MAX_SAMPLES",
    "MIN_EDGE_HEIGHT",
    "NEAR_PX",
    "STAGES",
    "RepairConfig",
]

# Stages that can be switched off, in the order of their work.
STAGES = (
    "denoise",
    "sharpen",
    "register",
    "deblur",
    "snap",
    "thin",
    "grow",
)

# Side of the blocks in which changes are accepted, pixels.
BLOCK_PX = 8

# Half width of the smallest window around a pixel or a depth edge, pixels.
NEAR_PX = BLOCK_PX // 4

# Difference of encoded colours, Euclidean over three channels, up to which they are similar.
COLOR_SIGMA = 0.06

# Minimum height of a depth edge, as a fraction of the range of the map.
MIN_EDGE_HEIGHT = 0.05

# Approximate number of evenly spaced edge pixels from which a quantity of the whole map is estimated.
MAX_SAMPLES = 2000


@dataclass(frozen=True, kw_only=True, slots=True)
class RepairConfig:
    """Numbers of the diagnosis, of the acceptance and of the pyramid, and the stages that run.

    Attributes:
        stages: Names of the stages that run, a subset of ``STAGES``.
        noise_range: Lower and upper bound of the noise that is removed: standard deviation as a fraction of
            the range of the map. Maps without noise have up to 0.0014, normal deviates alone 0.114, the
            mismatches of a failed plane sweep 0.078.
        min_softness: Fraction of soft edges from which the edges of a map are sharpened and follow colour
            edges. Sharp maps of hair have up to 0.17.
        base_side_px: Maximum side of the size at which map and picture are compared and the stages propose.
        max_shift_px: Upper bound of translation and growth.
        min_certainty: Minimum certainty of the edge profile of a map for any change. Profiles of random maps
            reach 0.01, those of interpolated lidar points 0.21, those of faulty maps 0.3 and more.
        agreement_window_blocks: Half width of the window in which the agreement of both maps with the picture
            is compared, blocks of 8 pixels.
        agreement_prior: Pseudo-count of edge pixels: with the agreement of the whole map in each window, and
            without agreement in the whole map. With 50 in the whole map, a few changed edges changed an exact
            map.
        min_gain: Minimum gain of agreement for a change of the map; for a translation or growth of all edges,
            as a fraction of the agreement after it.
    """

    stages: frozenset[str] = frozenset(STAGES)
    noise_range: tuple[float, float] = (0.003, 0.075)
    min_softness: float = 0.25
    base_side_px: int = 1024
    max_shift_px: int = BLOCK_PX
    min_certainty: float = 0.25
    agreement_window_blocks: int = 2
    agreement_prior: float = 150.0
    min_gain: float = 0.15
