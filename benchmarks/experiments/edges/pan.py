"""Slow pan over a synthetic scene, and the change of a method's error from frame to frame."""

from dataclasses import dataclass, replace

import numpy as np

from bokehnet.checks import Array
from bokehnet.lenses import Rays, ThinLens
from bokehnet.synth import SynthConfig
from bokehnet.synth.clutter.baked_scene import View
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.config import ClutterConfig
from bokehnet.synth.pairs import lens_for_view
from train.scores.metrics import encode

__all__ = ["Frame", "flicker", "pan"]

_WIDTH, _HEIGHT = 160, 120
_BLUR, _FOCUS, _SEED = 12.0, 0.5, 7

# Rays per pixel of truth and picture; pan in pixels per frame; number of frames.
_TRUTH, _IMAGE, _STEP, _FRAMES = 512, 64, 0.25, 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """All-in-focus picture, its defocus in pixels, and two renderings of its truth."""

    image: np.ndarray
    defocus: np.ndarray
    truths: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class _Panned:
    """Thin lens with a sensor shifted sideways; see :class:`bokehnet.lenses.base.LensModel`."""

    lens: ThinLens
    shift: float

    def sample_rays(self, sensor_xy: Array, pupil_uv: Array) -> Rays:
        return self.lens.sample_rays(sensor_xy + np.array([self.shift, 0], np.float32), pupil_uv)


def pan(frames: int = _FRAMES) -> list[Frame]:
    """Return frames of a sensor that moves by a quarter of a pixel per frame."""
    config = SynthConfig(seed=1, scenes=1, width=_WIDTH, height=_HEIGHT, bokeh_samples=1, image_samples=1)
    config = replace(
        config, clutter=ClutterConfig(places=(0, 1, 0), foreground_probability=1, lamp_probability=0)
    )
    scene = random_clutter(np.random.default_rng(_SEED), config).scene

    def view(samples: int, seed: int) -> View:
        return View(width=_WIDTH, height=_HEIGHT, pixel_pitch=config.pixel_pitch, samples=samples, seed=seed)

    pinhole = ThinLens(focal_length=config.sensor_distance, f_number=1.0)
    nearest = 0.9 / float(scene.disparity(pinhole, view(1, 0)).max())
    lens = lens_for_view(_BLUR, _FOCUS, replace(config, nearest_distance=nearest))
    gain, result = 0.0, []
    for number in range(frames):
        shifted_lens = _Panned(lens, _STEP * number * config.pixel_pitch)
        image = scene.render(shifted_lens, view(_IMAGE, number), False)  # type: ignore[arg-type]
        gain = gain or 0.2 / float(np.median(image))
        inverse = scene.disparity(shifted_lens, view(1, 0))  # type: ignore[arg-type]
        truths = [
            (gain * scene.render(shifted_lens, view(_TRUTH, 100 + 2 * number + half))).astype(np.float32)  # type: ignore[arg-type]
            for half in (0, 1)
        ]
        result.append(
            Frame(
                image=(gain * image).astype(np.float32),
                defocus=np.asarray(lens.coc_radius(inverse) / config.pixel_pitch, np.float32),
                truths=(truths[0], truths[1]),
            )
        )
    return result


def flicker(pictures: list[np.ndarray], truths: list[np.ndarray]) -> float:
    """Return the RMS change of a method's encoded error from frame to frame, per cent of white.

    An error that stays in place, or moves with the picture in steps far below a pixel, is not flicker.

    Args:
        pictures: Scene-linear, (H, W, 3) each.
        truths: True pictures, (H, W, 3) each.
    """
    errors = np.stack([encode(one) - encode(other) for one, other in zip(pictures, truths, strict=True)])
    return 100 * float(np.sqrt((np.diff(errors, axis=0) ** 2).mean()))
