"""Recovery of the light that a display-referred picture has clipped."""

from dataclasses import dataclass, field

import numpy as np

from bokehnet.light.areas import add_areas
from bokehnet.light.bright_picture import Array, BrightPicture, Indices, ramp
from bokehnet.light.clip_level import ClipLevel, clip_levels
from bokehnet.light.config import DEFAULT_CONFIG, LightConfig
from bokehnet.light.lamps import add_lamps

__all__ = ["RecoveredLight", "estimated_light", "measured_light", "picture_of", "recover_light"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RecoveredLight:
    """Picture with recovered light.

    Attributes:
        image: Scene-linear picture, (H, W, 3); the input itself if nothing was recovered.
        fraction: Fraction of the pixels that were brightened.
        largest: Largest light, relative to the clip level; 1 if nothing was recovered.
        source: Origin of the light, for the summary.
        pixels: Indices of the brightened pixels in the flattened picture, (N,).
    """

    image: Array
    fraction: float = 0.0
    largest: float = 1.0
    source: str = "estimated"
    pixels: Indices = field(default_factory=lambda: np.zeros(0, np.intp))

    @classmethod
    def of(cls, image: Array, recovered: Array, level: float, strength: float = 1.0) -> "RecoveredLight":
        """Compare a picture with its recovered light.

        Args:
            image: Scene-linear picture, (H, W, 3).
            recovered: The same with recovered light.
            level: Clip level.
            strength: Factor on the light above the stored one.
        """
        brightened = recovered[..., 0] > image[..., 0]
        for channel in (1, 2):
            brightened |= recovered[..., channel] > image[..., channel]
        if not brightened.any():
            return cls(image=image)
        if strength != 1:
            recovered = image + np.float32(strength) * (recovered - image)
        return cls(
            image=recovered,
            fraction=float(brightened.mean()),
            largest=float(recovered[brightened].max() / level),
            pixels=np.flatnonzero(brightened),
        )

    @property
    def note(self) -> str:
        """Summary in a few words; empty if nothing was recovered."""
        if not self.fraction:
            return ""
        percent = f"{100 * self.fraction:.2g}" if self.fraction >= 1e-4 else "under 0.01"
        return f"{percent} % clipped, {self.source} up to {self.largest:.0f}x white"


def recover_light(
    image: Array,
    nearness: Array | None = None,
    strength: float = 1.0,
    config: LightConfig = DEFAULT_CONFIG,
) -> RecoveredLight:
    """Estimate the radiance of clipped light and leave bright matter unchanged.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        nearness: Map in which near is large, such as disparity or signed defocus, (H, W); locates the
            farthest layer, where skies are.
        strength: Factor on the estimated light above the stored one.
        config: Constants.

    Examples:
        >>> street = np.full((90, 120, 3), 0.004, np.float32)  # a lamp of 5x5 pixels at night
        >>> street[40:45, 60:65] = 1
        >>> recovered = recover_light(street)
        >>> bool(recovered.image[42, 62].min() > 4), float(recovered.image[10, 10, 0]) == street[10, 10, 0]
        (True, True)
        >>> dark = np.full((90, 120, 3), 0.004, np.float32)
        >>> recover_light(dark).image is dark
        True
    """
    picture = picture_of(image, nearness, config) if strength > 0 else None
    if picture is None:
        return RecoveredLight(image=image)
    return RecoveredLight.of(image, estimated_light(picture), picture.level, strength)


def picture_of(image: Array, nearness: Array | None, config: LightConfig) -> BrightPicture | None:
    """Measure a picture; None if nothing in it can be clipped light. Arguments as :func:`recover_light`."""
    if image.size == 0 or not np.isfinite(image).all():
        return None
    levels = _common_levels(image, config)
    if levels is None or _is_drawing(image, levels.clipped, config):
        return None
    picture = BrightPicture.of(image, nearness, levels, config)
    # By day matter of a saturated colour and blue skies clip in one channel.
    return picture if levels.channels > 1 or picture.median < config.night[1] else None


def estimated_light(picture: BrightPicture) -> Array:
    """Return a picture with its estimated light, (H, W, 3)."""
    result = picture.image.copy()
    is_lamp = add_lamps(picture, result)
    add_areas(picture, result, is_lamp)
    return result


def measured_light(
    image: Array, light: Array, kind: str, strength: float = 1.0, config: LightConfig = DEFAULT_CONFIG
) -> RecoveredLight:
    """Return a picture with the light above white that its gain map measured.

    Pixels from ``config.bright`` up receive it, fully from white up: the tone curve of the rest stays that
    of the picture.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        light: Light according to the gain map, (H, W, 3).
        kind: Name of the gain map, for the summary.
        strength: Factor on the light above the stored one.
        config: Constants.

    Examples:
        >>> image = np.array([[[0.1, 0.1, 0.1], [1, 1, 0.9]]], np.float32)
        >>> measured_light(image, 4 * image, "Ultra HDR").image[0].round(2).tolist()
        [[0.1..., 0.1..., 0.1...], [4.0, 4.0, 3.5...]]
    """
    highest = image.max(-1)
    weight = ramp(highest, (config.bright, 1.0)).astype(np.float32)
    excess = np.maximum(light - image, 0) * (np.float32(strength) * weight[..., None])
    brightened = excess.max(-1, initial=0) > 0
    if not brightened.any() or not np.isfinite(excess).all():
        return RecoveredLight(image=image)
    result = image + excess
    return RecoveredLight(
        image=result,
        fraction=float(brightened.mean()),
        largest=float(result.max()),
        source=f"by the {kind} gain map",
        pixels=np.flatnonzero(brightened),
    )


def _is_drawing(image: Array, level: float, config: LightConfig) -> bool:
    """Return whether nearly all pixels between black and white equal both neighbours in their row.

    Photographs have noise and shading; drawings and screenshots have flat colours.
    """
    rows = image[:: max(1, image.shape[0] // 500)]
    equal = np.logical_and.reduce([rows[:, 1:, c] == rows[:, :-1, c] for c in range(3)])
    red, green, blue = (rows[:, 1:-1, c] for c in range(3))
    highest = np.maximum(np.maximum(red, green), blue)
    is_shown = (highest > config.black) & (highest < level)
    count = int(is_shown.sum())
    return count == 0 or bool((equal[:, 1:] & equal[:, :-1])[is_shown].sum() > config.flat * count)


def _common_levels(image: Array, config: LightConfig) -> ClipLevel | None:
    """Return the clip level of the whole picture; None if channels clip at different ones."""
    levels = clip_levels(
        image,
        lowest=config.lowest_level,
        min_pixels=max(config.min_pixels, int(config.min_fraction * image.shape[0] * image.shape[1])),
        min_pile=config.min_pile,
        margin=config.margin,
    )
    known = [level for level in levels if level is not None]
    codes = [level.code for level in known]
    if not known or max(codes) - min(codes) > config.level_spread:
        return None
    return ClipLevel(
        code=min(codes),
        clipped=min(level.clipped for level in known),
        top=min(level.top for level in known),
        shoulder=float(np.median([level.shoulder for level in known])),
        channels=len(known),
    )
