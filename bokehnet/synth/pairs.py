"""One training sample: a scene, its all-in-focus picture, its disparity and views with bokeh."""

import math

import numpy as np

from bokehnet.lenses import ThinLens
from bokehnet.raytrace import Camera, render_all_in_focus, render_bokeh, render_disparity
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.scenes import random_scene
from bokehnet.synth.shards import TrainingSample

__all__ = ["lens_for_view", "make_sample"]

# A picture with less depth than this has no blur worth learning from; it is not blown up further.
_LEAST_RANGE = 0.1
# Scenes with lights beyond this radiance need more rays.
_BRIGHT = 16.0


def make_sample(config: SynthConfig, index: int) -> TrainingSample:
    """Render scene ``index`` of a set; depends on ``config`` and ``index`` alone."""
    rng = np.random.default_rng(np.random.SeedSequence([config.seed, index]))
    scene = random_scene(rng, config)
    pinhole = _camera(config, ThinLens(focal_length=config.sensor_distance, f_number=1.0))
    seeds = rng.integers(2**62, size=config.views + 1)
    image = render_all_in_focus(scene, pinhole, config.image_samples, int(seeds[0])).numpy()
    disparity = render_disparity(scene, pinhole).numpy() * np.float32(config.nearest_distance)
    views = [_draw_view(disparity, config, rng) for _ in range(config.views)]
    brightest = max((float(plane.texture.max()) for plane in scene.planes), default=0.0)
    samples = config.bokeh_samples * (config.bright_factor if brightest > _BRIGHT else 1)
    bokeh = [
        render_bokeh(scene, _camera(config, lens_for_view(blur, focus, config)), samples, int(seed)).numpy()
        for (blur, focus), seed in zip(views, seeds[1:], strict=True)
    ]
    assert np.isfinite(image).all()
    assert np.isfinite(bokeh).all()
    return TrainingSample(
        image=image.astype(np.float16),
        disparity=disparity,
        bokeh=np.stack(bokeh).astype(np.float16),
        blur=np.array([blur for blur, _ in views], np.float32),
        focus=np.array([focus for _, focus in views], np.float32),
    )


def lens_for_view(blur: float, focus: float, config: SynthConfig) -> ThinLens:
    """Return the lens that blurs by ``blur * (disparity - focus)`` pixels.

    Args:
        blur: Radius in pixels per unit of relative disparity, positive.
        focus: Relative disparity that is sharp; 0 focuses at infinity.
        config: Sensor and scale. The sensor distance is that of ``config`` for all lenses, so the focal
            length follows from the focus by the thin-lens equation.
    """
    focus_disparity = focus / config.nearest_distance
    pupil_radius = blur * config.nearest_distance * config.pixel_pitch / config.sensor_distance
    focal_length = 1 / (1 / config.sensor_distance + focus_disparity)
    return ThinLens(
        focal_length=focal_length,
        f_number=focal_length / (2 * pupil_radius),
        focus_distance=1 / focus_disparity if focus_disparity > 0 else math.inf,
    )


def _draw_view(disparity: np.ndarray, config: SynthConfig, rng: np.random.Generator) -> tuple[float, float]:
    """Draw blur and focus: mostly on something that is in the picture, sometimes in between."""
    if rng.random() < 0.8:
        low, high = float(disparity.min()), float(disparity.max())
        # Half by area, half by depth, so that small near things are in focus too.
        wanted = (
            disparity.flat[rng.integers(disparity.size)] if rng.random() < 0.5 else rng.uniform(low, high)
        )
        focus = float(disparity.flat[np.abs(disparity - wanted).argmin()])
    else:
        focus = float(rng.random())
    radius = np.exp(rng.uniform(*np.log(config.defocus)))
    return float(radius / max(np.abs(disparity - focus).max(), _LEAST_RANGE)), focus


def _camera(config: SynthConfig, lens: ThinLens) -> Camera:
    return Camera(lens=lens, width=config.width, height=config.height, pixel_pitch=config.pixel_pitch)
