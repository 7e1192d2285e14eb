"""Constants of the detection and recovery of clipped light."""

from dataclasses import dataclass

__all__ = ["DEFAULT_CONFIG", "LightConfig"]


@dataclass(frozen=True, kw_only=True, slots=True)
class LightConfig:
    """Constants of :func:`bokehnet.light.recovery.recover_light`.

    ``python -m benchmarks.quality.clipped_light --ablate`` measures them.

    Light is linear, relative to the clip level, unless a unit is given.

    Attributes:
        lowest_level: Minimum clip level, 8-bit sRGB code.
        level_spread: Maximum difference of the clip levels of the channels, codes.
        min_pile: Minimum ratio of the pixels per code at the clip level to those below.
        min_fraction: Minimum fraction of the picture's pixels at the clip level of a channel.
        min_pixels: The same, pixels.
        margin: Codes below the clip level that count as clipped.
        high_key: Clipped fraction of the picture up to which skies and windows are light, and from which the
            picture is paper, snow or a drawing.
        black: Light of black pixels, which do not count for that.
        flat: Fraction of equal neighbours from which a picture is a drawing or a screenshot.
        bright: Light of the pixels that form a region.
        area_gain: Radiance of a large light such as a sky or a window.
        area_sharp_gain: Logarithm of the radiance of large lights per sharpness of their edges above that of
            matter, with a hard clip and with a shoulder that ends below white.
        area_gain_min: Minimum radiance measured so, with a hard clip and with a shoulder: what a shoulder
            that ends below white clips is brighter than white.
        area_gain_max: Maximum radiance measured by the sharpness of edges.
        matter_sharpness: Sharpness of the edges of matter just at the clip level, with a hard clip and with a
            shoulder that ends below white.
        aligned_sharpness: Sharpness up to which edges measure the radiance, and from which they are parallel
            to the rows or columns of pixels and measure nothing, with a hard clip and with a shoulder.
        aligned_gain: Radiance of large lights with such edges.
        near_sharpness: Sharpness above that of large lights in front of the farthest layer, with a hard clip.
        edge_blur: Light two pixels from an edge over that at one pixel, from which the point spread function
            hides the radiance, partly and altogether.
        min_edge_pixels: Minimum number of edge pixels for that.
        edge_dark: Light of the dark side of an edge.
        min_weight: Minimum weight of a region; regions below it stay unchanged.
        fill_far: Clipped fraction of a region in the farthest layer from which it can be light, and from
            which it is.
        fill: The same elsewhere.
        shading: Mean radiance of the clipped pixels of a layer, according to its unclipped ones, up to which
            they are matter, and from which they can be light, with a hard clip and with a shoulder.
        clutter: Fraction of a layer that is unclipped for other reasons than shading, in the farthest layer
            and elsewhere.
        cell: Side of the cells that measure shading, fraction of the diagonal, if that is more than
            ``cell_px``.
        cell_px: The same, pixels.
        even_light: Maximum standard deviation of a cell that measures shading, relative to its mean.
        surround: Mean light of the dark surroundings up to which a region is light, and from which it is not.
        color_power: Exponent of the colour of the bright pixels around a large light.
        far: Depth range that counts as farthest layer, fraction of the picture's range of defocus.
        pooled_pixels: Pixels of all regions of a layer together that each region's own are added to, in the
            farthest layer and elsewhere.
        lamp_radius: Maximum radius of a lamp, fraction of the diagonal, if that is more than
            ``lamp_radius_px``.
        lamp_radius_px: The same, pixels.
        lamp_fill: Minimum clipped fraction of a lamp, and the fraction from which it is one.
        lamp_surround: Mean light of the surroundings up to which a lamp is one, and from which it is not.
        max_depth_span: Maximum difference of the nearness of a lamp's pixels to that of its middle, and of
            its halo above it, fraction of the range of the map.
        night: Median light of the picture up to which small lights are lamps, and from which they are not.
        dusk: The same for glints of any share of the clipped pixels.
        dusk_sharpness: Sharpness of their edges up to which they are matter, and from which they are glints.
            Without a point spread function matter just above white reaches 1.3.
        sharp_gain: Radiance of lamps without a halo over the sharpness of their edges.
        lamp_gain: Minimum and maximum radiance of a lamp without a halo.
        max_lamp_gain: Maximum radiance of a lamp, mean over its clipped pixels.
        lamp_fraction: Fraction of the picture in lamps up to which they are lamps, and from which the
            picture is white text on black.
        lamp_share: Share of lamps in the clipped pixels from which the picture shows lamps.
        glint_share: The same portion from which small lights by day can be glints, and from which they are.
        glint_sharpness: Sharpness of their edges up to which they are matter, and from which they are glints.
        glint_dark: Light of the dark side of these edges.
        glint_surround: Mean light of the surroundings up to which a small light by day is a glint, and from
            which it is not.
        glint_gain: Light of glints over that of lamps with equally sharp edges.
        halo_level: Light down to which a halo is measured.
        halo_growth: Growth of a lamp's radius down to that level, relative to its radius, from which it has
            a halo.
        halo_excess: Light of a channel that is not clipped, according to the halo and relative to the stored
            one, up to which the halo is that of the lamp, and from which it is not.
        halo_tolerance: Ratio of the flux measured by the halo at ``bright`` to that at ``halo_level`` for a
            lamp with the halo of a point.
        edge_width: The same growth of a sharp edge, pixels.
        core_radius: Radius of the image of a point without its halo, pixels.
        concentration: Exponent of the brightness with which the light of a lamp with a halo is distributed.
        edge_power: Exponent of the clipped fraction of a pixel's neighbours with which the light of a lamp
            without a halo is distributed.
        min_color: Minimum light of a channel relative to the strongest one that measures a lamp.
        weak_color: The same, maximum of the channels that measure the shoulder of the tone curve.
        near_clip: Minimum light of the strongest channel for that.
        shoulder_quantile: Quantile of the light of these pixels that is the end of the shoulder.
        shoulder_pixels: Number of these pixels for half of the certainty.
        max_shoulder: Maximum light at which a tone curve clips.
        hidden_pixels: Clipped pixels of a lamp whose light is unknown for each of them with all channels
            clipped.
        diffraction: Wavelength times f-number, pixels.
        surround_reach: Half-width of the surroundings, fraction of the diagonal.
    """

    lowest_level: int = 248
    level_spread: int = 2
    min_pile: float = 2.5
    min_fraction: float = 2e-5
    min_pixels: int = 8
    margin: int = 3
    high_key: tuple[float, float] = (0.45, 0.6)
    black: float = 5e-4
    flat: float = 0.88
    bright: float = 0.5
    area_gain: float = 7.0
    area_sharp_gain: tuple[float, float] = (2.05, 2.7)
    area_gain_min: tuple[float, float] = (1.0, 2.5)
    area_gain_max: float = 6.5
    matter_sharpness: tuple[float, float] = (0.77, 0.5)
    aligned_sharpness: tuple[tuple[float, float], tuple[float, float]] = ((1.8, 2.2), (1.1, 1.7))
    aligned_gain: float = 4.5
    near_sharpness: float = 0.32
    edge_blur: tuple[float, float] = (0.38, 0.5)
    min_edge_pixels: int = 30
    edge_dark: float = 0.15
    min_weight: float = 0.1
    fill_far: tuple[float, float] = (0.35, 0.5)
    fill: tuple[float, float] = (0.8, 0.93)
    shading: tuple[tuple[float, float], tuple[float, float]] = ((1.3, 1.8), (1.1, 1.4))
    clutter: tuple[float, float] = (0.1, 0.0)
    cell: float = 0.005
    cell_px: int = 8
    even_light: float = 0.04
    surround: tuple[float, float] = (0.12, 0.3)
    color_power: float = 2.0
    far: float = 0.08
    pooled_pixels: tuple[float, float] = (400.0, 150.0)
    lamp_radius: float = 0.012
    lamp_radius_px: float = 8.0
    lamp_fill: tuple[float, float] = (0.1, 0.2)
    lamp_surround: tuple[float, float] = (0.1, 0.2)
    max_depth_span: float = 0.1
    night: tuple[float, float] = (0.02, 0.035)
    dusk: tuple[float, float] = (0.06, 0.1)
    dusk_sharpness: tuple[float, float] = (1.3, 1.8)
    sharp_gain: float = 6.0
    lamp_gain: tuple[float, float] = (1.0, 40.0)
    max_lamp_gain: float = 80.0
    lamp_fraction: tuple[float, float] = (0.04, 0.08)
    lamp_share: tuple[float, float] = (0.2, 0.5)
    glint_share: tuple[float, float] = (0.7, 0.9)
    glint_sharpness: tuple[float, float] = (1.1, 1.6)
    glint_dark: float = 0.3
    glint_surround: tuple[float, float] = (0.2, 0.35)
    glint_gain: float = 0.5
    halo_level: float = 0.2
    halo_growth: tuple[float, float] = (0.05, 0.2)
    halo_excess: tuple[float, float] = (8.0, 16.0)
    halo_tolerance: float = 2.5
    edge_width: float = 0.3
    core_radius: float = 0.9
    concentration: float = 16.0
    edge_power: float = 4.0
    min_color: float = 0.03
    weak_color: float = 0.6
    near_clip: float = 0.93
    shoulder_quantile: float = 0.75
    shoulder_pixels: float = 3.0
    max_shoulder: float = 4.0
    hidden_pixels: float = 4.0
    diffraction: float = 0.95
    surround_reach: float = 0.03


DEFAULT_CONFIG = LightConfig()
