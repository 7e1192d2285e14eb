"""Small lights in dark surroundings: their flux from their halo, unclipped channels and sharp edges."""

from dataclasses import dataclass

import numpy as np

from bokehnet.light.bright_picture import Array, BrightPicture, Floats, Mask, ramp
from bokehnet.light.components import Components, connected_components
from bokehnet.light.edges import edge_pixels, sharpness
from bokehnet.light.visible import edge_light, visible_light

__all__ = ["add_lamps"]


def add_lamps(picture: BrightPicture, result: Array) -> Mask:
    """Add the missing light of lamps to ``result`` (H, W, 3), and return the mask of their pixels (H, W)."""
    config = picture.config
    used = np.zeros(picture.lowest.shape, bool)
    half = config.bright * picture.level
    regions = connected_components(picture.highest >= half)
    if regions.count == 0:
        return used
    at = regions.rows, regions.columns
    area = regions.sums()
    clipped = regions.sums(picture.highest[at] >= picture.level)
    weight = _lamp_weights(picture, regions, area, clipped)
    if not weight.any():
        return used
    neighbors = _clipped_neighbors(picture, regions)
    nearness = picture.relative_nearness(*at)
    core = _core_nearness(picture, regions, neighbors, nearness)
    halo = _Halo.of(picture, regions, area, core)
    is_lamp = np.abs(nearness - core[regions.labels]) <= config.max_depth_span
    stored = np.stack([regions.sums(picture.image[(*at, c)] / picture.level) for c in range(3)], -1)
    is_clipped = np.stack([regions.sums(picture.image[(*at, c)] >= picture.level) > 0 for c in range(3)], -1)
    halo_flux = np.stack([halo.flux(picture, channel) for channel in range(3)], -1)
    # A halo that says much more of an unclipped channel than it holds is matter or light around the lamp.
    excess = np.where(is_clipped, 0, halo_flux / np.maximum(stored, 1)).max(-1)
    has_halo = halo.weight * ramp(excess, config.halo_excess[::-1])
    centrality = _centrality(picture, regions, neighbors, has_halo)
    flux = _flux(picture, regions, (weight > 0, has_halo, clipped), halo_flux)
    for channel in range(3):
        values = picture.image[(*at, channel)].astype(np.float64)
        shape = is_lamp * centrality * np.clip((values - half) / (picture.level - half), 0, 1) ** 2
        missing = np.maximum(flux[:, channel] - stored[:, channel], 0) * picture.level
        missing *= weight * is_clipped[:, channel]
        result[(*at, channel)] += (missing / np.maximum(regions.sums(shape), 1e-6))[regions.labels] * shape
    used[at] = (weight > 0)[regions.labels]
    return used


def _flux(
    picture: BrightPicture, regions: Components, lamps: tuple[Mask, Floats, Floats], halo_flux: Floats
) -> Floats:
    """Return the flux of each lamp, relative to the clip level, (regions, 3).

    Args:
        picture: Picture.
        regions: Bright regions.
        lamps: Whether each is a lamp, the certainty that it has a halo, its clipped pixels, (regions,) each.
        halo_flux: Flux according to the halo, (regions, 3).
    """
    config = picture.config
    is_lamp, has_halo, clipped = lamps
    color, edge = edge_light(picture, regions, is_lamp, has_halo < 0.5)
    visible = visible_light(picture, regions, color)
    gain = float(np.clip(config.sharp_gain * edge, *config.lamp_gain)) * visible.shoulder
    sharp = visible.flux + visible.hidden * np.maximum(gain, visible.least)
    second = np.sort(picture.image[regions.rows, regions.columns], axis=-1)[:, 1]
    is_white = regions.sums(second >= picture.level) > 0
    # The core of a point of light is unknown even where noise or chroma subsampling lowers a channel.
    unknown = np.maximum(config.hidden_pixels * visible.hidden, clipped * is_white * (has_halo >= 1))
    limit = config.max_lamp_gain * np.minimum(unknown, clipped)
    flux = has_halo[:, None] * halo_flux + (1 - has_halo[:, None]) * color * sharp[:, None]
    return np.asarray(np.minimum(flux, color * visible.flux[:, None] + limit[:, None]))


def _lamp_weights(picture: BrightPicture, regions: Components, area: Floats, clipped: Floats) -> Floats:
    """Return the certainty, 0 to 1, that bright regions are lamps, or glints by day, (regions,).

    Args:
        picture: Picture.
        regions: Bright regions.
        area: Pixels of each, (regions,).
        clipped: Clipped pixels of each, (regions,).
    """
    config, at = picture.config, (regions.rows, regions.columns)
    max_radius = max(config.lamp_radius * picture.diagonal, config.lamp_radius_px)
    is_small = (np.sqrt(area / np.pi) <= max_radius) & (clipped > 0)
    small = float(clipped[is_small].sum())
    portion = small / max(float(clipped.sum()), 1)
    common = ramp(portion, config.lamp_share)
    common = common * ramp(small / picture.lowest.size, config.lamp_fraction[::-1])
    night, day = float(ramp(picture.median, config.night[::-1])), 0.0
    if night < 1 and common > 0:
        sharp = _edge_sharpness(picture, regions, is_small)
        day = float(ramp(portion, config.glint_share) * ramp(sharp, config.glint_sharpness))
        dusk = float(ramp(picture.median, config.dusk[::-1]) * ramp(sharp, config.dusk_sharpness))
        day = max(day, dusk)
    certainty = common * is_small * ramp(clipped / area, config.lamp_fill)
    if (night == 0 and day == 0) or not certainty.any():
        return np.zeros(regions.count)
    surround = regions.sums(picture.surround(*at)) / area
    lamp, glint = (ramp(surround, ends[::-1]) for ends in (config.lamp_surround, config.glint_surround))
    return np.asarray(certainty * np.maximum(night * lamp, config.glint_gain * day * glint))


def _edge_sharpness(picture: BrightPicture, regions: Components, is_small: Mask) -> float:
    """Return the sharpness of the edges of small regions clipped in all channels; 0 for too few edges."""
    config, at = picture.config, (regions.rows, regions.columns)
    core = np.flatnonzero((picture.lowest[at] >= picture.level) & is_small[regions.labels])
    dark = config.glint_dark * picture.level
    _, y, x, *_ = edge_pixels(picture.lowest, picture.level, at[0][core], at[1][core], dark)
    if len(y) < config.min_edge_pixels:
        return 0.0
    return sharpness(np.maximum(picture.lowest[y, x] / picture.level - picture.surround(y, x), 0))


def _core_nearness(
    picture: BrightPicture, regions: Components, neighbors: Floats, nearness: Floats
) -> Floats:
    """Return the relative nearness of the middle of each region, (regions,).

    The middle is the clipped pixel with most clipped neighbours, the nearest of several: what surrounds a
    lamp smaller than its glare has the depth of the wall behind.

    Args:
        picture: Picture.
        regions: Bright regions.
        neighbors: Clipped pixels among the 3x3 around each pixel, (N,).
        nearness: Relative nearness of each pixel, (N,).
    """
    core = np.flatnonzero(picture.highest[regions.rows, regions.columns] >= picture.level)
    order = core[np.lexsort((nearness[core], neighbors[core], regions.labels[core]))]
    result = np.zeros(regions.count)
    result[regions.labels[order]] = nearness[order]  # the last of each region stays
    return result


def _clipped_neighbors(picture: BrightPicture, regions: Components) -> Floats:
    """Return the number of clipped pixels among the 3x3 around each pixel of the regions, (N,)."""
    clipped = np.pad(picture.highest >= picture.level, 1)
    neighbors = np.zeros(len(regions.rows))
    for down in range(3):
        for right in range(3):
            neighbors += clipped[regions.rows + down, regions.columns + right]
    return neighbors


def _centrality(picture: BrightPicture, regions: Components, neighbors: Floats, halo: Floats) -> Floats:
    """Return the weight of each pixel in the light of its lamp, largest in the middle of its core, (N,).

    Edge pixels of a sharp lamp are clipped although it covers them in part: pixels count by their clipped
    neighbours. The light of a point is where the least clipped channel is brightest.
    """
    whole = picture.image[regions.rows, regions.columns].sum(-1, dtype=np.float64)
    peak = np.zeros(regions.count)
    np.maximum.at(peak, regions.labels, whole)
    weight = halo[regions.labels]
    point = (whole / peak[regions.labels]) ** (picture.config.concentration * weight)
    return np.asarray(point * (neighbors / 9) ** (picture.config.edge_power * (1 - weight)))


@dataclass(frozen=True, slots=True, eq=False)
class _Halo:
    """Halos of small lights: the regions where light is above a low level.

    Attributes:
        wide: Regions above that level.
        parent: Wide region of each light, (regions,).
        portion: Portion of its wide region that belongs to each light, by area, (regions,).
        weight: 1 for lights with the halo of a point of light, 0 for those with a sharp edge, (regions,).
    """

    wide: Components
    parent: np.ndarray
    portion: Floats
    weight: Floats

    @classmethod
    def of(cls, picture: BrightPicture, regions: Components, area: Floats, core: Floats) -> "_Halo":
        """Measure the halos of lights whose cores have the relative nearness ``core``, (regions,).

        Bright matter in front of a light is no halo.
        """
        config = picture.config
        wide = connected_components(picture.highest >= config.halo_level * picture.level)
        index = np.full(picture.lowest.shape, -1, np.int32)
        index[wide.rows, wide.columns] = wide.labels
        first = np.unique(regions.labels, return_index=True)[1]
        parent = index[regions.rows[first], regions.columns[first]]
        portion = area / np.bincount(parent, area, wide.count)[parent]
        radius = np.sqrt(area / np.pi)
        wide_radius = np.sqrt(wide.sums()[parent] * portion / np.pi)
        # A sharp edge widens by the pixel filter alone.
        growth = (wide_radius - radius - config.edge_width) / np.maximum(radius, 0.5)
        nearest = np.zeros(wide.count)
        shown = np.flatnonzero(picture.highest[wide.rows, wide.columns] < picture.level)
        near = picture.relative_nearness(wide.rows[shown], wide.columns[shown])
        np.maximum.at(nearest, wide.labels[shown], near)
        is_free = nearest[parent] <= core + config.max_depth_span
        return cls(wide, parent, portion, is_free * ramp(growth, config.halo_growth))

    def flux(self, picture: BrightPicture, channel: int) -> Floats:
        """Return the flux of each light in a channel, in pixels at the clip level, (regions,).

        The diffraction halo of a point of flux F at radius r is F L / (pi^3 r^3), for L = wavelength times
        f-number in pixels. The radius at which it falls to a level gives F; the
        smaller of two levels counts, because other light may reach the lower one.

        Source:
            Born and Wolf, "Principles of optics", 8.5.2: 2 L / (pi^2 r) of the light is outside radius r.
        """
        config, fluxes = picture.config, []
        values = picture.image[self.wide.rows, self.wide.columns, channel]
        for level, tolerance in ((config.halo_level, 1.0), (config.bright, config.halo_tolerance)):
            above = self.wide.sums(values >= level * picture.level)[self.parent] * self.portion
            radius = np.maximum(np.sqrt(above / np.pi) - config.core_radius, 0)
            fluxes.append(tolerance * level * np.pi**3 / config.diffraction * radius**3)
        return np.minimum(*fluxes)
