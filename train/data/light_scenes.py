"""Scenes with clipped light or bright matter, traced with their true radiance, and cameras that clip them.

A scene has planes in front of a background (:mod:`bokehnet.raytrace`). Light: skies behind trees, windows of
dark rooms, lamps at night, lamps with the halo of a stopped-down lens, coloured lamps, signs and screens, sun
glints. Matter: white cards with shading, pages of text, petals, snow, white clothes, overexposed walls,
clouds and products on white, which reach the clip level but are hardly brighter.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    background_from,
    plane_texture,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)
from bokehnet.raytrace.surfaces.shapes import OPEN_SHAPES, SOLID_SHAPES, THIN_SHAPES, draw_shape
from bokehnet.raytrace.surfaces.textures import fractal_noise, glyph_page, light_points
from bokehnet.synth import SynthConfig
from bokehnet.synth.pairs import lens_for_view
from bokehnet.synth.surface_textures import surface_texture

__all__ = [
    "CAMERAS",
    "LIGHT",
    "MATTER",
    "CameraCurve",
    "LightCase",
    "cases",
    "decoded",
    "light_picture",
    "make_case",
    "with_halo",
]

_CONFIG = SynthConfig(seed=1, scenes=1, width=384, height=256)
_HALF = np.array([_CONFIG.sensor_width / 2, _CONFIG.sensor_width / 2 * 256 / 384]) / _CONFIG.sensor_distance
_BLUR_PX, _IMAGE_SAMPLES, _TRUTH_SAMPLES = 22.0, 24, 192
# Wavelength times f-number over pixel pitch: the halo of a point at radius r pixels is this / (pi^3 r^3).
_DIFFRACTION_PX = (0.3, 1.2)
_FOCUS = 0.9


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraCurve:
    """Tone curve of a camera.

    Attributes:
        shoulder: Linear light from which values are compressed; 1 clips hard.
        top: Stored value of clipped light, 8 bit.
        white: Linear light that is stored as ``top``.
        exposure: Factor on the light.
    """

    shoulder: float = 1.0
    top: int = 255
    white: float = 1.0
    exposure: float = 1.0

    def store(self, light: np.ndarray) -> np.ndarray:
        """Return the stored picture (H, W, 3) uint8 of scene-linear light."""
        light = self.exposure * light
        if self.shoulder < 1:
            width, limit = self.white - self.shoulder, 1 - self.shoulder
            u = np.clip((light - self.shoulder) / width, 0, 1)
            # Slope 1 at the shoulder, falling to 0 at white: u k / (1 + (k - 1) u), k = width / limit.
            k = width / limit
            light = np.where(light > self.shoulder, self.shoulder + limit * k * u / (1 + (k - 1) * u), light)
        encoded = linear_to_srgb(np.clip(light, 0, 1).astype(np.float32)) * self.top
        return np.round(encoded).astype(np.uint8)


CAMERAS = {
    "hard": CameraCurve(),
    "shoulder": CameraCurve(shoulder=0.6, top=252, white=2.0),
    "film": CameraCurve(shoulder=0.35, white=5.0),
    "soft": CameraCurve(shoulder=0.8, top=254, white=1.5),
    "dark": CameraCurve(exposure=0.6),
    "bright": CameraCurve(shoulder=0.7, white=2.0, exposure=1.5),
}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LightCase:
    """One picture with its truth.

    Attributes:
        name: Kind, seed.
        image: True radiance in focus everywhere, with the halo of the lens, (H, W, 3).
        disparity: Relative disparity, (H, W).
        truth: True radiance through the open lens, (H, W, 3).
        blur: Blur radius in pixels per unit of disparity.
        focus: Disparity in focus.
    """

    name: str
    image: np.ndarray
    disparity: np.ndarray
    truth: np.ndarray
    blur: float
    focus: float


def _card(
    rgb: np.ndarray,
    alpha: np.ndarray | None,
    middle: tuple[float, float],
    half: tuple[float, float],
    near: float,
) -> Plane:
    """Return a plane that faces the lens; ``middle`` and ``half`` are fractions of the half picture."""
    depth = _CONFIG.nearest_distance / near
    x, y = np.array(middle) * _HALF * depth
    u, v = np.array(half) * _HALF * depth
    return Plane(
        texture=plane_texture(rgb.astype(np.float32), alpha),
        centre=(float(x), float(y), depth),
        u_axis=(float(u), 0.0, 0.0),
        v_axis=(0.0, float(v), 0.0),
    )


def _textured(rng: np.random.Generator, mean: float, size: tuple[int, int] = (256, 384)) -> np.ndarray:
    """Return a texture (H, W, 3) of a mean brightness, at most 0.9 times white."""
    colours = surface_texture(_CONFIG.scene, *size, rng)
    ratio = colours * np.float32(mean / max(float(colours.mean()), 1e-3) / 0.9)
    return 0.9 * ratio / (1 + ratio**8) ** 0.125  # smooth: a hard limit would pile up like clipped light


def _subject(rng: np.random.Generator, mean: float) -> Plane:
    """Return a near object at disparity 0.9."""
    alpha = draw_shape(SOLID_SHAPES, 220, 200, rng)
    middle = (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.2, 0.6)))
    return _card(_textured(rng, mean, (220, 200)), alpha, middle, (0.4, 0.75), 0.9)


def _far(rgb: np.ndarray, disparity: float) -> Background:
    half = (float(_HALF[0]) * 1.15, float(_HALF[1]) * 1.15)
    return background_from(rgb.astype(np.float32), half, disparity / _CONFIG.nearest_distance)


def _sky(rng: np.random.Generator) -> Scene:
    """Return trees before a bright sky."""
    level, y = np.exp(rng.uniform(np.log(1.5), np.log(9))), np.linspace(0, 1, 256)[:, None, None]
    tint = np.array([1 - 0.25 * rng.random(), 1, 1 + 0.35 * rng.random()])
    clouds = 1 + 0.6 * (fractal_noise(256, 384, rng, 1.6)[..., None] - 0.5)
    sky = level * clouds * (tint * (1 - y) + np.array([1.1, 1.0, 0.85]) * y)
    planes = []
    for _ in range(rng.integers(4, 9)):
        alpha = draw_shape(THIN_SHAPES if rng.random() < 0.7 else OPEN_SHAPES, 300, 300, rng)
        middle = (float(rng.uniform(-1, 1)), float(rng.uniform(-0.4, 0.6)))
        size = float(rng.uniform(0.6, 1.3))
        dark = _textured(rng, float(rng.uniform(0.02, 0.12)), (300, 300))
        planes.append(_card(dark, alpha, middle, (size, size * 1.4), float(rng.uniform(0.04, 0.3))))
    ground = _textured(rng, float(rng.uniform(0.05, 0.2)), (120, 384))
    planes.append(_card(ground, None, (0, 1.0), (1.3, float(rng.uniform(0.1, 0.6))), 0.06))
    return Scene(background=_far(sky, 0.0), planes=(*planes, _subject(rng, float(rng.uniform(0.08, 0.3)))))


def _window(rng: np.random.Generator) -> Scene:
    """Return a room with a bright window."""
    wall = _textured(rng, float(rng.uniform(0.03, 0.15)))
    near, planes = float(rng.uniform(0.1, 0.3)), []
    for _ in range(rng.integers(1, 3)):
        middle = (float(rng.uniform(-0.8, 0.8)), float(rng.uniform(-0.5, 0.3)))
        half = (float(rng.uniform(0.12, 0.35)), float(rng.uniform(0.25, 0.5)))
        level = np.exp(rng.uniform(np.log(2), np.log(12)))
        pane = level * (0.7 + 0.6 * fractal_noise(160, 120, rng, 1.8)[..., None]) * np.array([0.92, 1, 1.1])
        planes.append(_card(pane, None, middle, half, near))
        bar = np.full((8, 8, 3), 0.05, np.float32)
        planes.append(_card(bar, None, middle, (0.02, half[1]), near * 1.05))
        planes.append(_card(bar, None, middle, (half[0], 0.03), near * 1.05))
    return Scene(
        background=_far(wall, near * 0.9), planes=(*planes, _subject(rng, float(rng.uniform(0.05, 0.25))))
    )


def _night(rng: np.random.Generator) -> Scene:
    """Return lamps before a dark background."""
    wall = _textured(rng, float(rng.uniform(0.005, 0.04)))
    far, planes = float(rng.uniform(0.0, 0.15)), []
    for _ in range(2):
        lamps, alpha = light_points(256, 384, rng, (0.7, 2.2), (8.0, 150.0))
        planes.append(_card(lamps, alpha, (0, 0), (1, 1), float(rng.uniform(far + 0.01, 0.4))))
    if rng.random() < 0.6:
        sign = np.exp(rng.uniform(np.log(1.5), np.log(8))) * rng.uniform(0.1, 1, 3) * np.ones((40, 60, 1))
        middle = (float(rng.uniform(-0.7, 0.7)), float(rng.uniform(-0.6, 0.3)))
        planes.append(_card(sign, None, middle, (0.12, 0.07), far + 0.02))
    return Scene(background=_far(wall, far), planes=(*planes, _subject(rng, float(rng.uniform(0.02, 0.1)))))


def _fairy(rng: np.random.Generator) -> Scene:
    """Return lamps of one saturated colour each, which clip in one or two channels, before a dark wall."""
    far = float(rng.uniform(0.0, 0.15))
    colors = np.array([[1, 0.55, 0.2], [1, 0.3, 0.1], [0.25, 1, 0.35], [0.2, 0.4, 1], [1, 0.8, 0.5]])
    color, planes = colors[rng.integers(len(colors))], []
    for _ in range(rng.integers(1, 4)):
        mixed = rng.random() < 0.3
        lamps, alpha = light_points(256, 384, rng, (0.7, 3.5), (1.5, 60.0))
        tint = colors[rng.integers(len(colors))] if mixed else color * rng.uniform(0.85, 1.15, 3)
        middle = (float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-0.3, 0.3)))
        planes.append(_card(lamps.mean(-1, keepdims=True) * tint, alpha, middle, (1, 1), far + 0.05))
    wall = _textured(rng, float(rng.uniform(0.004, 0.03)))
    return Scene(background=_far(wall, far), planes=(*planes, _subject(rng, float(rng.uniform(0.02, 0.1)))))


def _signs(rng: np.random.Generator) -> Scene:
    """Return neon signs and screens at dusk."""
    far, planes = float(rng.uniform(0.05, 0.2)), []
    for _ in range(rng.integers(2, 6)):
        level = np.exp(rng.uniform(np.log(0.8), np.log(10)))
        if rng.random() < 0.5:  # neon: strokes of one colour
            alpha, tint = draw_shape(THIN_SHAPES, 160, 160, rng), rng.uniform(0.05, 1, 3)
            light = level * np.ones((160, 160, 1)) * tint / tint.max()
        else:  # screen: a picture with its own whites
            alpha = None
            light = level * surface_texture(_CONFIG.scene, 160, 160, rng)
        middle = (float(rng.uniform(-0.8, 0.8)), float(rng.uniform(-0.7, 0.3)))
        size = float(rng.uniform(0.08, 0.25))
        planes.append(_card(light, alpha, middle, (size, size), float(rng.uniform(far + 0.01, 0.35))))
    wall = _textured(rng, float(rng.uniform(0.01, 0.08)))
    return Scene(background=_far(wall, far), planes=(*planes, _subject(rng, float(rng.uniform(0.03, 0.15)))))


def _glints(rng: np.random.Generator) -> Scene:
    """Return glints of the sun on water or metal by day."""
    lamps, alpha = light_points(256, 384, rng, (0.5, 1.8), (5.0, 200.0))
    water = _textured(rng, float(rng.uniform(0.04, 0.3)))
    height = float(rng.uniform(0.2, 0.9))
    glints = _card(lamps.mean(-1, keepdims=True) * np.ones(3), alpha, (0, 0.4), (1, height), 0.06)
    return Scene(background=_far(water, 0.05), planes=(glints, _subject(rng, float(rng.uniform(0.05, 0.3)))))


def _white_shading(rng: np.random.Generator, size: tuple[int, int], level: float) -> np.ndarray:
    """Return white matter (H, W, 3) whose illumination changes slowly around ``level``."""
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / np.array(size).max()
    angle, slope = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.5)
    light = level * (1 + slope * (np.cos(angle) * (x - x.mean()) + np.sin(angle) * (y - y.mean())))
    fine = 1 + 0.12 * (fractal_noise(*size, rng, 1.3) - 0.5)
    return (light * fine)[..., None] * (1 - np.array([0, 0.02, 0.06]) * rng.random())


def _pale_plane(
    rng: np.random.Generator,
    white: np.ndarray,
    alpha: np.ndarray | None,
    reach: tuple[float, float, float],
    size: tuple[float, float, float],
    near: tuple[float, float],
) -> Plane:
    """Return a plane of pale matter at a random position.

    Args:
        rng: Random generator.
        white: Radiance, (H, W, 3).
        alpha: Coverage, (H, W); None for a rectangle.
        reach: Maximum horizontal position, and bounds of the vertical one, fractions of the half picture.
        size: Bounds of the half width, fraction of the half picture, and height over width.
        near: Bounds of the disparity.
    """
    middle = (float(rng.uniform(-reach[0], reach[0])), float(rng.uniform(*reach[1:])))
    half = float(rng.uniform(*size[:2]))
    return _card(white, alpha, middle, (half, half * size[2]), float(rng.uniform(*near)))


def _cards(rng: np.random.Generator) -> Scene:
    """Return white cards, some of them pages of text, before a wall of middle brightness."""
    planes = []
    for _ in range(rng.integers(2, 6)):
        white = _white_shading(rng, (200, 200), float(rng.uniform(0.85, 1.25)))
        if rng.random() < 0.4:
            page = glyph_page(200, 200, rng).mean(-1, keepdims=True)
            white = white * np.clip(page / max(float(page.max()), 1e-3), 0.05, 1)
        alpha = draw_shape(SOLID_SHAPES, 200, 200, rng)
        planes.append(_pale_plane(rng, white, alpha, (0.9, -0.7, 0.5), (0.1, 0.4, 1.3), (0.15, 0.7)))
    wall = _textured(rng, float(rng.uniform(0.06, 0.3)))
    return Scene(background=_far(wall, 0.1), planes=(*planes, _subject(rng, float(rng.uniform(0.1, 0.3)))))


def _houses(rng: np.random.Generator) -> Scene:
    """Return white houses and signs in the farthest layer, lit by the sun, with trees before them."""
    planes = []
    for _ in range(rng.integers(2, 6)):
        white = _white_shading(rng, (160, 200), float(rng.uniform(0.8, 1.15)))
        planes.append(_pale_plane(rng, white, None, (0.9, -0.8, 0.3), (0.08, 0.35, 1.2), (0.05, 0.05)))
    for _ in range(rng.integers(1, 4)):
        alpha = draw_shape(THIN_SHAPES if rng.random() < 0.7 else OPEN_SHAPES, 300, 300, rng)
        middle = (float(rng.uniform(-1, 1)), float(rng.uniform(-0.4, 0.6)))
        planes.append(_card(_textured(rng, 0.06, (300, 300)), alpha, middle, (0.9, 1.2), 0.15))
    wall = _textured(rng, float(rng.uniform(0.05, 0.25)))
    return Scene(background=_far(wall, 0.04), planes=(*planes, _subject(rng, float(rng.uniform(0.1, 0.3)))))


def _petals(rng: np.random.Generator) -> Scene:
    """Return pale petals and small bright spots of matter before leaves."""
    planes = []
    for _ in range(rng.integers(4, 12)):
        white = _white_shading(rng, (120, 120), float(rng.uniform(0.6, 1.15)))
        white = white * np.array([1, rng.uniform(0.8, 1), rng.uniform(0.75, 1)])
        alpha = draw_shape(SOLID_SHAPES, 120, 120, rng)
        planes.append(_pale_plane(rng, white, alpha, (1, -0.9, 0.8), (0.03, 0.2, 1.5), (0.1, 0.7)))
    wall = _textured(rng, float(rng.uniform(0.02, 0.12)))
    return Scene(background=_far(wall, 0.08), planes=(*planes, _subject(rng, 0.3)))


def _snow(rng: np.random.Generator) -> Scene:
    """Return snow that fills the lower picture under a moderate sky."""
    white = _white_shading(rng, (200, 384), float(rng.uniform(0.85, 1.15)))
    ground = _card(white, None, (0, 0.7), (1.3, 0.75), 0.1)
    trees = []
    for _ in range(3):
        alpha = draw_shape(THIN_SHAPES, 200, 200, rng)
        middle = (float(rng.uniform(-1, 1)), float(rng.uniform(-0.3, 0.2)))
        trees.append(_card(_textured(rng, 0.06, (200, 200)), alpha, middle, (0.6, 0.9), 0.15))
    sky = _textured(rng, float(rng.uniform(0.3, 0.6)))
    return Scene(background=_far(sky, 0.0), planes=(ground, *trees, _subject(rng, 0.25)))


def _clothes(rng: np.random.Generator) -> Scene:
    """Return people in white clothes with folds, near and far, before a wall or leaves."""
    planes = []
    for _ in range(rng.integers(1, 4)):
        folds = fractal_noise(200, 160, rng, float(rng.uniform(1.4, 2.0)))[..., None]
        cloth = _white_shading(rng, (200, 160), float(rng.uniform(0.7, 1.2))) * (0.6 + 0.7 * folds)
        alpha = draw_shape(SOLID_SHAPES, 200, 160, rng)
        middle = (float(rng.uniform(-0.8, 0.8)), float(rng.uniform(0.0, 0.6)))
        size = float(rng.uniform(0.12, 0.5))
        planes.append(_card(cloth, alpha, middle, (size, size * 1.5), float(rng.uniform(0.1, 0.85))))
    wall = _textured(rng, float(rng.uniform(0.02, 0.3)))
    return Scene(background=_far(wall, 0.08), planes=(*planes, _subject(rng, float(rng.uniform(0.1, 0.4)))))


def _wall(rng: np.random.Generator) -> Scene:
    """Return a white wall with a patch of sun."""
    light = np.float32(rng.uniform(0.45, 0.8)) * np.ones((256, 384, 1))
    patch = draw_shape(SOLID_SHAPES, 256, 384, rng)[..., None]
    wall = (
        light
        * (1 + patch * rng.uniform(0.5, 0.9))
        * (1 + 0.05 * (fractal_noise(256, 384, rng)[..., None] - 0.5))
    )
    return Scene(background=_far(wall * np.array([1, 0.98, 0.94]), 0.1), planes=(_subject(rng, 0.2),))


def _clouds(rng: np.random.Generator) -> Scene:
    """Return white clouds in a blue sky, lit by the sun, behind trees."""
    cover = np.clip(3 * (fractal_noise(256, 384, rng, 1.8)[..., None] - rng.uniform(0.35, 0.6)), 0, 1)
    white = _white_shading(rng, (256, 384), float(rng.uniform(0.75, 1.2)))
    blue = float(rng.uniform(0.3, 0.7)) * np.array([0.45, 0.7, 1.0])
    planes = []
    for _ in range(rng.integers(1, 5)):
        alpha = draw_shape(THIN_SHAPES if rng.random() < 0.7 else OPEN_SHAPES, 300, 300, rng)
        middle = (float(rng.uniform(-1, 1)), float(rng.uniform(-0.2, 0.7)))
        planes.append(_card(_textured(rng, 0.06, (300, 300)), alpha, middle, (0.8, 1.1), 0.1))
    sky = (1 - cover) * blue + cover * white
    return Scene(background=_far(sky, 0.0), planes=(*planes, _subject(rng, float(rng.uniform(0.1, 0.4)))))


def _product(rng: np.random.Generator) -> Scene:
    """Return products on a white table before a white wall, lit up to the clip level."""
    level = float(rng.uniform(0.9, 1.3))
    wall = _white_shading(rng, (256, 384), level) / (1 + 0.3 * rng.random())
    planes = [_card(_white_shading(rng, (120, 384), level), None, (0, 1.0), (1.3, 0.5), 0.4)]
    for _ in range(rng.integers(1, 4)):
        alpha = draw_shape(SOLID_SHAPES, 200, 160, rng)
        middle = (float(rng.uniform(-0.7, 0.7)), float(rng.uniform(-0.2, 0.5)))
        tinted = _textured(rng, float(rng.uniform(0.05, 0.6)), (200, 160))
        planes.append(_card(tinted, alpha, middle, (0.25, 0.5), float(rng.uniform(0.4, 0.8))))
    return Scene(background=_far(wall, 0.1), planes=(*planes, _subject(rng, float(rng.uniform(0.1, 0.5)))))


LIGHT: dict[str, Callable[[np.random.Generator], Scene]] = {
    "sky": _sky,
    "window": _window,
    "night": _night,
    "lamps": _night,  # with the halo of the lens
    "fairy": _fairy,
    "signs": _signs,
    "glints": _glints,
}
_WITH_HALO = ("lamps", "fairy")
MATTER: dict[str, Callable[[np.random.Generator], Scene]] = {
    "cards": _cards,
    "houses": _houses,
    "petals": _petals,
    "snow": _snow,
    "clothes": _clothes,
    "wall": _wall,
    "clouds": _clouds,
    "product": _product,
}


def with_halo(light: np.ndarray, diffraction_px: float) -> np.ndarray:
    """Convolve light with the mean diffraction halo of a stopped-down lens.

    Source:
        The integral of the Airy pattern beyond radius r is 2 L / (pi^2 r) for L = wavelength times f-number
        (Born and Wolf, "Principles of optics", 8.5.2), so its mean at r is L / (pi^3 r^3).
    """
    reach = 96
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.maximum(np.hypot(y, x), 1.0)
    kernel = diffraction_px / (np.pi**3 * distance**3)
    kernel[reach, reach] = 0
    kernel[reach, reach] = 1 - kernel.sum()
    kernel /= kernel.sum()
    return np.stack([fftconvolve(light[..., c], kernel, mode="same") for c in range(3)], -1).clip(0)


def light_picture(
    kind: str, rng: np.random.Generator, seed: int, scale: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the true radiance (H, W, 3) of a scene in focus everywhere, and its disparity (H, W).

    Args:
        kind: Key of :data:`LIGHT` or :data:`MATTER`.
        rng: Generator of the scene.
        seed: Seed of the rays.
        scale: Size of the picture, multiple of 384x256 pixels.
    """
    scene, view = (LIGHT | MATTER)[kind](rng), _camera(_BLUR_PX, scale)
    image = render_all_in_focus(scene, view, _IMAGE_SAMPLES // scale, seed).numpy()
    return image, _disparity(scene, view)


def make_case(kind: str, seed: int) -> LightCase:
    """Trace a scene of a kind of :data:`LIGHT` or :data:`MATTER`."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    scene, view = (LIGHT | MATTER)[kind](rng), _camera(_BLUR_PX)
    image = render_all_in_focus(scene, view, _IMAGE_SAMPLES, seed).numpy()
    if kind in _WITH_HALO:
        image = with_halo(image, float(rng.uniform(*_DIFFRACTION_PX)))
    return LightCase(
        name=f"{kind}_{seed}",
        image=image.astype(np.float32),
        disparity=_disparity(scene, view),
        truth=render_bokeh(scene, view, _TRUTH_SAMPLES, seed + 1).numpy(),
        blur=_BLUR_PX,
        focus=_FOCUS,
    )


def _camera(blur: float, scale: int = 1) -> Camera:
    lens, pitch = lens_for_view(blur, _FOCUS, _CONFIG), _CONFIG.pixel_pitch / scale
    return Camera(lens=lens, width=scale * _CONFIG.width, height=scale * _CONFIG.height, pixel_pitch=pitch)


def _disparity(scene: Scene, view: Camera) -> np.ndarray:
    nearest = np.float32(_CONFIG.nearest_distance)
    return np.asarray((render_disparity(scene, view).numpy() * nearest).clip(0, 1))


def cases(kinds: tuple[str, ...], seeds: Iterable[int]) -> Iterator[LightCase]:
    """Yield the scenes of some kinds, one for each seed."""
    for kind in kinds:
        for seed in seeds:
            yield make_case(kind, seed)


def decoded(stored: np.ndarray) -> np.ndarray:
    """Return the light of a stored picture as a reader of sRGB files decodes it."""
    return srgb_to_linear(stored.astype(np.float32) / np.float32(255))
