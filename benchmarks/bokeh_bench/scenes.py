"""Scenes of the benchmark: drawn from seeds, traced through a thin lens, checked against pinned values.

The sensor of the camera is ``_SENSOR_DISTANCE`` behind the lens for any focus, so that focusing does not
zoom. The description scales depth and pupil by one factor, so that the first shot's f-number gives the
intended blur; blur radii do not depend on the factor.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bokeh_bench import VERSION
from bokehnet.checks import Array
from bokehnet.errors import DataFileError
from bokehnet.io.channels import write_channels
from bokehnet.io.files.atomic import write_text
from bokehnet.io.formats.encode import encode as write_pixels
from bokehnet.io.image import write_image
from bokehnet.lenses import Rays, ThinLens
from bokehnet.optics.aperture import Aperture, transmission
from bokehnet.synth import SynthConfig
from bokehnet.synth.clutter.baked_scene import View
from bokehnet.synth.clutter.lamps import add_lamps
from bokehnet.synth.clutter.scenes import Clutter, random_clutter
from bokehnet.synth.config import ClutterConfig
from train.scores.metrics import depth_step_pixels, encode, psnr

__all__ = ["SCENES", "make_scene", "prepare", "summary"]

_WIDTH, _HEIGHT = 320, 240
_SENSOR_WIDTH, _SENSOR_DISTANCE, _FOCAL_LENGTH = 36.0, 50.0, 50.0

# Rays per pixel of each of the two halves of a truth, and of the picture.
_HALF_SAMPLES, _IMAGE_SAMPLES = 256, 256

# Depth of the sky, m.
_SKY_DEPTH_M = 1e10

# Maximum deviation from a pinned mean, as a fraction of the picture's mean.
_TOLERANCE = 0.005


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Recipe of a scene.

    Attributes:
        seed: Seed of the scene.
        places: See ``ClutterConfig``.
        blur: Maximum blur radius of the first shot, pixels.
        thin: Fraction of thin objects.
        lamps: True if there are small lamps.
        focus: Quantile of the pixels' inverse depth in focus, for each shot.
        f_numbers: F-number of each shot.
        blades: Number of blades of each shot; 0 is a disc.
    """

    seed: int
    places: tuple[float, float, float]
    blur: float = 16.0
    thin: float = 0.35
    lamps: bool = False
    focus: tuple[float, float] = (0.5, 0.95)
    f_numbers: tuple[float, float] = (1.4, 2.0)
    blades: tuple[int, int] = (0, 6)


SCENES = {
    "table": Recipe(seed=11, places=(1, 0, 0)),
    "room": Recipe(seed=12, places=(0, 1, 0), focus=(0.3, 0.9)),
    "land": Recipe(seed=13, places=(0, 0, 1), blur=24.0),
    "twigs": Recipe(seed=14, places=(0, 0, 1), thin=1.0, focus=(0.1, 0.8)),
    "near": Recipe(seed=16, places=(0, 1, 0), blur=28.0, focus=(0.2, 0.6)),
    "lamps": Recipe(seed=17, places=(0, 1, 0), lamps=True, focus=(0.8, 0.4), blades=(0, 0)),
}


@dataclass(frozen=True)
class _BladedLens:
    """Thin lens with a stop of straight blades; see :class:`bokehnet.lenses.base.LensModel`."""

    lens: ThinLens
    aperture: Aperture

    def sample_rays(self, sensor_xy: Array, pupil_uv: Array) -> Rays:
        light = transmission(self.aperture, pupil_uv[..., 0], pupil_uv[..., 1])
        return replace(self.lens.sample_rays(sensor_xy, pupil_uv), weight=light.astype(np.float32))


def _config(recipe: Recipe) -> SynthConfig:
    clutter = ClutterConfig(
        places=recipe.places,
        thin_probability=recipe.thin,
        foreground_probability=1,
        lamp_probability=float(recipe.lamps),
    )
    return SynthConfig(
        seed=1,
        scenes=1,
        width=_WIDTH,
        height=_HEIGHT,
        sensor_width=_SENSOR_WIDTH,
        sensor_distance=_SENSOR_DISTANCE,
        clutter=clutter,
    )


def _render(
    clutter: Clutter, config: SynthConfig, lens: ThinLens, aperture: Aperture, view: View, pupil: bool
) -> np.ndarray:
    bladed_lens = _BladedLens(lens, aperture) if aperture.blades else lens
    picture = clutter.scene.render(bladed_lens, view, pupil)  # type: ignore[arg-type]
    if clutter.lamps:
        add_lamps(picture, clutter.scene, clutter.lamps, lens, view, pupil)
    return picture


def make_scene(name: str, folder: Path) -> dict[str, Any]:
    """Write a scene into ``folder``, and return the content of ``scene.json``."""
    recipe = SCENES[name]
    config = _config(recipe)
    clutter = random_clutter(np.random.default_rng(recipe.seed), config)

    def view(samples: int, seed: int) -> View:
        return View(width=_WIDTH, height=_HEIGHT, pixel_pitch=config.pixel_pitch, samples=samples, seed=seed)

    pinhole, disc = ThinLens(focal_length=_SENSOR_DISTANCE, f_number=1.0), Aperture()
    inverse = clutter.scene.disparity(pinhole, view(1, 0)).astype(np.float64)  # 1/mm
    in_focus = [float(np.quantile(inverse[inverse > 0], quantile)) for quantile in recipe.focus]
    image = _render(clutter, config, pinhole, disc, view(_IMAGE_SAMPLES, 0), False)
    gain = np.float32(0.2 / np.median(image))
    scale = _scale(recipe, in_focus[0], float(np.abs(inverse - in_focus[0]).max()), config.pixel_pitch)
    shots: list[dict[str, Any]] = []
    pictures = {}
    for number, focus in enumerate(in_focus):
        described_lens = ThinLens(
            focal_length=_FOCAL_LENGTH, f_number=recipe.f_numbers[number], focus_distance=scale / focus
        )
        # R s |1/z - 1/z_f| is the same for both lenses.
        pupil = described_lens.pupil_radius * described_lens.sensor_distance / (scale * _SENSOR_DISTANCE)
        focal_length = 1 / (1 / _SENSOR_DISTANCE + focus)
        lens = ThinLens(
            focal_length=focal_length, f_number=focal_length / (2 * pupil), focus_distance=1 / focus
        )
        aperture = Aperture(blades=recipe.blades[number])
        halves = [
            gain * _render(clutter, config, lens, aperture, view(_HALF_SAMPLES, 100 * number + half), True)
            for half in (1, 2)
        ]
        truth = (halves[0] + halves[1]) / 2
        defocus = np.asarray(lens.coc_radius(inverse) / config.pixel_pitch)
        file = f"bokeh_{number:02d}.exr"
        pictures[file] = truth
        shots.append(
            {
                "file": file,
                "f_number": described_lens.f_number,
                "focus_distance_m": described_lens.focus_distance / 1000,
                "blades": aperture.blades,
                "blade_rotation_deg": 0.0,
                "largest_radius_px": float(np.abs(defocus).max()),
                "truth_noise": _noise(halves, depth_step_pixels(inverse, defocus)),
            }
        )
    near, far = float(inverse.max() / scale * 1000), float(inverse.min() / scale * 1000)
    depth = np.where(inverse > 0, scale / 1000 / np.maximum(inverse, 1e-12), _SKY_DEPTH_M)
    folder.mkdir(parents=True, exist_ok=True)
    write_image(folder / "image.exr", gain * image, bits="float")
    write_image(folder / "image.png", gain * image, dither=False)
    write_channels(folder / "depth.exr", {"Z": depth})
    levels = np.round(65535 * (inverse / scale * 1000 - far) / (near - far)).astype(np.uint16)
    grey = levels[..., None]
    write_pixels(folder / "disparity.png", grey.shape, np.uint16, grey.__getitem__, ("Y",), {})
    for file, picture in pictures.items():
        write_image(folder / file, picture, bits="float")
    scene = {
        "benchmark": VERSION,
        "scene": name,
        "width": _WIDTH,
        "height": _HEIGHT,
        "focal_length_mm": _FOCAL_LENGTH,
        "sensor_width_mm": _SENSOR_WIDTH,
        "disparity": {"kind": "1/z", "min": far, "max": near},
        "shots": shots,
        "summary": summary(gain * image, inverse / max(inverse.max(), 1e-12), list(pictures.values())),
    }
    write_text(folder / "scene.json", json.dumps(scene, indent=1) + "\n")
    return scene


def _scale(recipe: Recipe, focus: float, farthest: float, pitch: float) -> float:
    """Return the scale of the described scene relative to the traced one.

    With focal length f, f-number N and focus at ``scale / focus``, the radius in pixels at a distance of
    ``farthest`` in inverse depth is ``f^2 / (2 N) farthest / (scale - f focus) / pitch``.
    """
    blur_mm = recipe.blur * pitch
    return _FOCAL_LENGTH**2 / (2 * recipe.f_numbers[0]) * farthest / blur_mm + _FOCAL_LENGTH * focus


def _noise(halves: list[np.ndarray], edges: np.ndarray) -> dict[str, float]:
    """Return the PSNR of the noise of the truth, dB.

    The halves have independent noise of variance 2 v and their mean has v: their difference has 4 v.
    """
    squared = (encode(halves[0]) - encode(halves[1])) ** 2 / 4
    return {"psnr": psnr(squared), "edge_psnr": psnr(squared[edges])}


def summary(image: np.ndarray, disparity: np.ndarray, truths: list[np.ndarray]) -> list[list[float]]:
    """Return the means of 4x4 blocks of every encoded picture, which identify the scene."""

    def blocks(values: np.ndarray) -> list[float]:
        rows, columns = values.shape[0] // 4, values.shape[1] // 4
        parts = values[: 4 * rows, : 4 * columns].reshape(4, rows, 4, columns, -1)
        return [round(float(mean), 5) for mean in parts.mean(axis=(1, 3, 4)).ravel()]

    return [blocks(encode(image)), blocks(disparity), *(blocks(encode(truth)) for truth in truths)]


def prepare(
    folder: Path, names: list[str], pinned: dict[str, Any], report: Callable[[str], None] = print
) -> None:
    """Make the scenes that are missing in ``folder``, and check all of them.

    Raises:
        DataFileError: A scene differs from the pinned one.
    """
    for name in names:
        file = folder / name / "scene.json"
        if file.exists():
            scene = json.loads(file.read_text(encoding="utf-8"))
        else:
            report(f"tracing {name} ...")
            scene = make_scene(name, folder / name)
        _check(folder / name, scene, pinned.get(name))


def _check(folder: Path, scene: dict[str, Any], pinned: list[list[float]] | None) -> None:
    actual = scene.get("summary")
    if scene.get("benchmark") != VERSION or pinned is None or np.shape(actual) != np.shape(pinned):
        raise DataFileError(f"{folder}: expected a scene of benchmark {VERSION}; remove the folder")
    for one, other in zip(np.asarray(actual), np.asarray(pinned), strict=True):
        deviation = float(np.abs(one - other).max() / max(float(np.mean(other)), 1e-6))
        if deviation > _TOLERANCE:
            raise DataFileError(
                f"{folder}: expected the pinned scene of benchmark {VERSION}, found one whose blocks are off"
                f" by {deviation:.1%}; install the versions of constraints.txt and remove the folder"
            )
