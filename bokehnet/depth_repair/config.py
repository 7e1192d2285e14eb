"""Numbers of the depth repair: all that its diagnosis, its stages and its acceptance use.

:class:`RepairConfig` holds what a caller may vary; the constants are part of compiled kernels.
``python -m benchmarks.quality.repair --ablate`` measures every stage, ``--harm`` the acceptance; figures in
the comments are theirs unless another source is named. Lengths are pixels of the size at which a stage runs.
"""

from dataclasses import dataclass

__all__ = [
    "BLOCK_PX",
    "BLUR_RADIUS",
    "BLUR_SIGMAS_PX",
    "BLUR_SIGMA_RATIO",
    "COLOR_SIGMA",
    "COLOR_VARIANCE",
    "DETAIL_BLOCK_PX",
    "ERROR_GROUPS",
    "FIRST_STEPS_AHEAD",
    "FIRST_TURNS",
    "GROWTH_RADIUS_PX",
    "HALF_DIFFERENCE_PX",
    "LIKELY_CONTRAST_RATIO",
    "LINE_COLOR_DIFFERENCE",
    "LINE_INSET_PX",
    "LINE_STEP_PX",
    "MAX_AGREEMENT",
    "MAX_DETAILS",
    "MAX_HALF_WIDTH_PX",
    "MAX_NEAR_FRACTION",
    "MAX_PEAK_DISTANCE_PX",
    "MAX_RAMP_PX",
    "MAX_RESIDUAL_RATIO",
    "MAX_SAMPLES",
    "MAX_SEED_DISTANCE_PX",
    "MAX_SLOPE_CHANGE",
    "MAX_WRONG_FRACTION",
    "MEDIAN_BINS",
    "MEDIAN_PASSES",
    "MIN_CHANGES",
    "MIN_CHANGING_FRACTION",
    "MIN_CONTRAST_RATIO",
    "MIN_COVERAGE_STEP",
    "MIN_DISTANCE_FROM_EXTREMES",
    "MIN_EDGE_HEIGHT",
    "MIN_GRADIENT",
    "MIN_MIXED_CHANGE",
    "MIN_MIXED_EDGE",
    "MIN_NOISE_SIDE_PX",
    "MIN_RELATIVE_AGREEMENT",
    "MIN_RESTORED",
    "MIN_SHARED_NOISE",
    "MIN_SLOPE_RATIO",
    "MIN_WEIGHT",
    "MIN_WEIGHT_RATIO",
    "MIN_WRONG_FRACTION",
    "NEAR_PX",
    "NEIGHBOURHOOD_PX",
    "NOISE_RADIUS",
    "NOISE_SIGMAS",
    "PEAK_SIDES_PX",
    "PROFILE_SCALES",
    "SAMPLE_SPACING_PX",
    "SHARED_NOISE_FACTOR",
    "SHARPENING_RADII_PX",
    "SLOPE_STRIDE_PX",
    "SMOOTHING_ORDER",
    "STAGES",
    "STANDARD_ERRORS",
    "STEPS_AHEAD",
    "TURNS",
    "TURN_RAD",
    "VAN_CITTERT_ITERATIONS",
    "WEIGHT_DECREASE",
    "RepairConfig",
]

# Shared

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

# Number of histogram bins between the lowest and the highest disparity in a window, for weighted medians.
MEDIAN_BINS = 24

# Edge profile

# Largest distance of a peak from the depth edge, and spacing of the samples, pixels.
MAX_PEAK_DISTANCE_PX, SAMPLE_SPACING_PX = BLOCK_PX + 1.0, 0.5

# Distances from a peak between which each of its two sides is measured, pixels, at scale 1. The peak is a
# sample with its neighbours. At scale n, its half width grows by n - 1 pixels, and the sides lie n times as
# far.
PEAK_SIDES_PX = (1.5, 3.5)

# Half length of the difference that measures the gradient, pixels.
HALF_DIFFERENCE_PX = 2 * SAMPLE_SPACING_PX

# Gradient per pixel, encoded light, that is added to the mean of each edge so that noise weighs little.
MIN_GRADIENT = 0.005

# Order of the binomial filter of the map before its slope is measured, even.
SMOOTHING_ORDER = 4

# Number of groups of edge pixels for the standard error, and number of standard errors subtracted.
ERROR_GROUPS, STANDARD_ERRORS = 16, 2.0

# Scales of the profiles of the whole map: edges of coarse maps are scattered around those of the picture.
PROFILE_SCALES = (1, 2, 3)

# Registration

# Minimum agreement of the edges with a displacement, relative to the one with the best agreement.
MIN_RELATIVE_AGREEMENT = 0.5

# Noise

# Minimum side of a map whose noise is estimated, pixels, and approximate maximum number of details used.
MIN_NOISE_SIDE_PX, MAX_DETAILS = 4 * BLOCK_PX, 2**18

# Errors that pixels share: side of the blocks whose means are compared, pixels; standard deviation of the
# errors over that of the means, for errors shared by 5 pixels; and least deviation that counts as noise, as a
# fraction of the range. Accurate maps by plane sweep have up to 0.0053 of detail, maps of networks 0.0002.
DETAIL_BLOCK_PX, SHARED_NOISE_FACTOR, MIN_SHARED_NOISE = BLOCK_PX // 2, 1.8, 0.008

# Joint bilateral filter: half width of the window in samples, also the distance of the samples in the first
# pass, pixels; and standard deviation of disparities, in those of the noise. With a half width of 2 maps with
# noise of 2 % have 2.3 dB less (``python -m benchmarks.speed.ratios noise``).
NOISE_RADIUS, NOISE_SIGMAS = 3, 2.0

# Bounds of the fraction of wrong pixels: exact maps have up to 0.0003, and above the upper bound they are the
# content.
MIN_WRONG_FRACTION, MAX_WRONG_FRACTION = 0.0005, 0.01

# Acceptance

# Maximum absolute agreement of a single edge pixel: a few strong edges must not outweigh all others.
MAX_AGREEMENT = 2.0

# Soft edges

# Soft pixels: minimum distance from both extremes of the window, as a fraction of the edge height.
MIN_DISTANCE_FROM_EXTREMES = 0.2

# Slope test: the rise over this stride (pixels) at a pixel must continue on both sides, with a sum of
# differences below this fraction of the rise. Gaussians wider than 6 pixels and ramps longer than 13 pixels
# pass as slopes.
SLOPE_STRIDE_PX, MAX_SLOPE_CHANGE = 3, 0.75

# Half widths of the windows that sharpen edges, pixels; together they sharpen ramps of ten pixels.
SHARPENING_RADII_PX = (NEAR_PX, SLOPE_STRIDE_PX)

# Weighted medians at soft edges: half width of the window, pixels, and standard deviation of encoded colours.
MEDIAN_PASSES = (
    (BLOCK_PX, COLOR_SIGMA / 2),
    (BLOCK_PX // 2, COLOR_SIGMA / 2),
    (NEAR_PX, 2 * COLOR_SIGMA),
)

# Blurred detail

# Candidates for the standard deviation of the blur, pixels, and the ratio of each and the one before; the
# smallest one means that the map is not soft.
BLUR_SIGMA_RATIO = 1.25
BLUR_SIGMAS_PX = tuple(BLUR_SIGMA_RATIO**i for i in range(1, 9))

# Radius of the Gaussian and half width of the windows of the guided filter, in standard deviations.
BLUR_RADIUS = 3

# Regularisation of the guided filter: variance of encoded colours that is regarded as noise.
COLOR_VARIANCE = 1e-4

# Number of van Cittert iterations.
VAN_CITTERT_ITERATIONS = 2

# Maximum ratio of the residuals of a soft map with and without its growth corrected at which the corrected
# one is used. Maps that were grown or shrunk before they were blurred have 0.24 to 0.7, others 0.68 to 0.92.
MAX_RESIDUAL_RATIO = 0.73

# Thin structures

# Length of a step along a line, pixels.
LINE_STEP_PX = 1.5

# Maximum distance of a seed from a piece, pixels; the minimum is ``NEAR_PX``.
MAX_SEED_DISTANCE_PX = BLOCK_PX // 2

# Number of candidate turns on each side, at a step and at the start, and their spacing, radians.
TURNS, FIRST_TURNS, TURN_RAD = 3, 6, 0.15

# Number of steps ahead by which turns are compared, at a step and at the start.
STEPS_AHEAD, FIRST_STEPS_AHEAD = 3, 5

# Relative decrease of the weight of a colour change per pixel of its distance from the centre line.
WEIGHT_DECREASE = 0.08

# Squared difference of encoded colours, summed over channels: maximum change of the profile of a line and
# maximum difference from its piece; minimum contrast of a line and its surroundings.
LINE_COLOR_DIFFERENCE = 0.02

# Minimum ratio of the contrast, its lower decile, and the change along a line; of likely lines, which light
# and shadow may cross.
MIN_CONTRAST_RATIO, LIKELY_CONTRAST_RATIO = 20.0, 4.0

# Likely lines: half width of the neighbourhood, pixels, and its minimum restored fraction.
NEIGHBOURHOOD_PX, MIN_RESTORED = 8 * BLOCK_PX, 0.03

# Reduction of each half width when a line is drawn, pixels, because several traces may overlap.
LINE_INSET_PX = 0.25

# Growth of thin structures

# Half width of the window in which colours are compared, pixels.
GROWTH_RADIUS_PX = 12

# Minimum ratio of the mean weights of near and far pixels, and minimum weight of the most similar near pixel.
MIN_WEIGHT_RATIO, MIN_WEIGHT = 2.0, 0.3

# Maximum fraction of near pixels in the window: at the end of a piece they are few, at the side of a large
# surface, into which lines of the background run, about half.
MAX_NEAR_FRACTION = 0.38

# Half width of the window that grown structures must not fill, pixels; thin structures of a map do not fill
# one of ``NEAR_PX``.
MAX_HALF_WIDTH_PX = BLOCK_PX // 2

# Mixed pixels

# Minimum difference of both surfaces, as a fraction of the range of the map.
MIN_MIXED_EDGE = 0.01

# Maximum width of a ramp, pixels: pixel filters are up to four pixels wide.
MAX_RAMP_PX = 3

# Minimum ratio of the slopes of every part of a ramp and of the surfaces on both sides.
MIN_SLOPE_RATIO = 2.0

# Minimum change of a pixel, as a fraction of the edge height: the surface of a round object, such as a ball,
# recedes at its edges.
MIN_MIXED_CHANGE = 0.1

# Minimum decrease of coverage from pixel to pixel in a ramp: two equal adjacent values are a surface.
MIN_COVERAGE_STEP = 0.02

# Repeated pixels

# Minimum number of changes, and minimum fraction of block borders with a change: otherwise the map may be a
# synthetic scene.
MIN_CHANGES, MIN_CHANGING_FRACTION = 8, 0.5


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
