"""Training samples: a random scene, its all-in-focus picture, its disparity and views with bokeh."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses import LensModel, ThinLens
from bokehnet.optics.pixels.supersampling import downsample
from bokehnet.raytrace import Camera, render_all_in_focus, render_bokeh, render_disparity
from bokehnet.synth.clutter.baked_scene import View
from bokehnet.synth.clutter.lamps import add_lamps
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.scenes import random_scene
from bokehnet.synth.shards import TrainingSample
from bokehnet.synth.subpixel import draw_pixel_filter
from bokehnet.synth.surface_textures import MIDDLE_GREY
from bokehnet.synth.training_lenses import make_training_lens

__all__ = ["lens_for_view", "make_sample"]

# Minimum range of relative disparity that the blur is scaled for; flatter scenes get less blur.
_MIN_DISPARITY_RANGE = 0.1
# Radiance above which a scene needs more rays.
_BRIGHT_RADIANCE = 16.0
# Range of the largest relative disparity of cluttered scenes.
_MAX_DISPARITY_RANGE = (0.75, 1.0)
# Maximum stopping down of a catalog lens, stops.
_MAX_STOPS = 2.0


@dataclass(frozen=True, kw_only=True, slots=True)
class _Subject:
    """Scene with its all-in-focus picture and a renderer of its views.

    Attributes:
        image: All-in-focus picture, (H, W, 3).
        disparity: Relative disparity, (H, W) float32.
        fine_disparity: Relative disparity on the finer grid, (k H, k W) float32; k may be 0.
        bokeh: Function of blur, focus and seed; returns a picture, (H, W, 3).
    """

    image: np.ndarray
    disparity: np.ndarray
    fine_disparity: np.ndarray
    bokeh: Callable[[float, float, int], np.ndarray]


def make_sample(config: SynthConfig, index: int) -> TrainingSample:
    """Render scene ``index`` of a set; the result depends only on ``config`` and ``index``."""
    rng = np.random.default_rng(np.random.SeedSequence([config.seed, index]))
    subject, seeds = (_planes if config.kind == "planes" else _clutter)(config, rng)
    views = [_draw_view(subject.disparity, config, rng) for _ in range(config.views)]
    bokeh = [subject.bokeh(blur, focus, int(seed)) for (blur, focus), seed in zip(views, seeds, strict=True)]
    assert np.isfinite(subject.image).all()
    assert np.isfinite(bokeh).all()
    pictures = np.stack(bokeh) if bokeh else np.zeros((0, *subject.image.shape))
    return TrainingSample(
        image=subject.image.astype(np.float16),
        disparity=subject.disparity,
        fine_disparity=subject.fine_disparity.astype(np.float16),
        bokeh=pictures.astype(np.float16),
        blur=np.array([blur for blur, _ in views], np.float32),
        focus=np.array([focus for _, focus in views], np.float32),
    )


def _planes(config: SynthConfig, rng: np.random.Generator) -> tuple[_Subject, np.ndarray]:
    """Return a scene of planes, and a seed for each view."""
    scene = random_scene(rng, config)
    pinhole = _camera(config, _pinhole(config))
    seeds = rng.integers(2**62, size=config.views + 1)
    disparity = render_disparity(scene, pinhole).numpy() * np.float32(config.nearest_distance)
    finer = _finer(config)
    fine_camera = _camera(finer, _pinhole(finer))
    image = render_all_in_focus(scene, fine_camera, config.image_samples, int(seeds[0])).numpy()
    fine_disparity = np.zeros((0, 0), np.float32)
    if config.fine:
        image = downsample(image, config.fine, draw_pixel_filter(rng))
        fine_disparity = render_disparity(scene, fine_camera).numpy() * np.float32(config.nearest_distance)
    brightest = max((float(plane.texture.max()) for plane in scene.planes), default=0.0)
    samples = config.bokeh_samples * (config.bright_factor if brightest > _BRIGHT_RADIANCE else 1)

    def bokeh(blur: float, focus: float, seed: int) -> np.ndarray:
        view = _camera(config, lens_for_view(blur, focus, config))
        picture: np.ndarray = render_bokeh(scene, view, samples, seed).numpy()
        return picture

    subject = _Subject(image=image, disparity=disparity, fine_disparity=fine_disparity, bokeh=bokeh)
    return subject, seeds[1:]


def _clutter(config: SynthConfig, rng: np.random.Generator) -> tuple[_Subject, np.ndarray]:
    """Return a scene of objects, and a seed for each view."""
    clutter = random_clutter(rng, config)
    seeds = rng.integers(2**62, size=config.views + 1)
    stops = rng.uniform(*config.scene.exposure_stops)

    def render(
        lens: LensModel, samples: int, seed: int, pupil: bool, size: SynthConfig = config
    ) -> np.ndarray:
        view = _view(size, samples, seed)
        picture = clutter.scene.render(lens, view, pupil)
        if clutter.lamps:
            assert isinstance(lens, ThinLens)
            add_lamps(picture, clutter.scene, clutter.lamps, lens, view, pupil)
        return picture

    pinhole = _pinhole(config)
    finer = _finer(config)
    image = render(pinhole, config.image_samples, int(seeds[0]), False, finer)
    inverse_depth = clutter.scene.disparity(pinhole, _view(config, 1, 0))
    fine_depth = np.zeros((0, 0), np.float32)
    if config.fine:
        image = downsample(image, config.fine, draw_pixel_filter(rng))
        fine_depth = clutter.scene.disparity(pinhole, _view(finer, 1, 0))
    nearest = rng.uniform(*_MAX_DISPARITY_RANGE) / max(float(inverse_depth.max()), 1e-9)
    scaled = replace(config, nearest_distance=float(nearest))
    # Excludes lamps, so that scenes with and without lamps are equally bright elsewhere.
    gain = np.float32(
        MIDDLE_GREY * 2**stops / max(float(np.minimum(image, np.median(image) * 8).mean()), 1e-6)
    )

    def bokeh(blur: float, focus: float, seed: int) -> np.ndarray:
        lens = lens_for_view(blur, focus, scaled) if clutter.lamps else _draw_lens(blur, focus, scaled, seed)
        return gain * render(lens, config.bokeh_samples, seed, True)

    subject = _Subject(
        image=gain * image,
        disparity=inverse_depth * np.float32(nearest),
        fine_disparity=fine_depth * np.float32(nearest),
        bokeh=bokeh,
    )
    return subject, seeds[1:]


def _finer(config: SynthConfig) -> SynthConfig:
    """Return the configuration with the resolution of the finer grid, if any."""
    factor = max(1, config.fine)
    return replace(config, width=factor * config.width, height=factor * config.height)


def _view(config: SynthConfig, samples: int, seed: int) -> View:
    return View(
        width=config.width,
        height=config.height,
        pixel_pitch=config.pixel_pitch,
        samples=samples,
        seed=seed,
    )


def lens_for_view(blur: float, focus: float, config: SynthConfig) -> ThinLens:
    """Return the thin lens with a blur radius of ``blur * (disparity - focus)`` pixels.

    Args:
        blur: Blur radius per unit of relative disparity, pixels, positive.
        focus: Relative disparity in focus; 0 is infinity.
        config: Sensor and scale. All lenses have the sensor distance of ``config``, so the thin-lens equation
            determines the focal length from the focus.
    """
    focus_disparity = focus / config.nearest_distance
    focal_length = 1 / (1 / config.sensor_distance + focus_disparity)
    return ThinLens(
        focal_length=focal_length,
        f_number=focal_length / (2 * _pupil_radius(blur, config)),
        focus_distance=1 / focus_disparity if focus_disparity > 0 else math.inf,
    )


def _draw_lens(blur: float, focus: float, config: SynthConfig, seed: int) -> LensModel:
    """Return a thin lens, or a catalog lens if it can focus at this distance."""
    thin = lens_for_view(blur, focus, config)
    rng = np.random.default_rng([seed, 2])
    if rng.random() >= config.catalog_share:
        return thin
    name, stops = config.catalog[rng.integers(len(config.catalog))], rng.uniform(0, _MAX_STOPS)
    try:
        return make_training_lens(name, thin.pupil_radius, thin.focus_distance, stops, config.sensor_distance)
    except LensError:
        return thin


def _pupil_radius(blur: float, config: SynthConfig) -> float:
    return blur * config.nearest_distance * config.pixel_pitch / config.sensor_distance


def _draw_view(disparity: np.ndarray, config: SynthConfig, rng: np.random.Generator) -> tuple[float, float]:
    """Draw blur and focus: mostly at a depth in the picture, sometimes at any depth."""
    if rng.random() < 0.8:
        low, high = float(disparity.min()), float(disparity.max())
        # Half by area, half by depth, so that small near objects are also in focus.
        target = (
            disparity.flat[rng.integers(disparity.size)] if rng.random() < 0.5 else rng.uniform(low, high)
        )
        focus = float(disparity.flat[np.abs(disparity - target).argmin()])
    else:
        focus = float(rng.random())
    radius = np.exp(rng.uniform(*np.log(config.defocus)))
    return float(radius / max(np.abs(disparity - focus).max(), _MIN_DISPARITY_RANGE)), focus


def _pinhole(config: SynthConfig) -> ThinLens:
    return ThinLens(focal_length=config.sensor_distance, f_number=1.0)


def _camera(config: SynthConfig, lens: ThinLens) -> Camera:
    return Camera(lens=lens, width=config.width, height=config.height, pixel_pitch=config.pixel_pitch)
