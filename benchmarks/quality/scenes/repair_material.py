"""Material of the repair benchmark: small path-traced scenes, and the maps of depth estimators.

Views from displaced pupils give light fields and stereo pairs. The scenes of the benchmark show photographs
that no training scene shows. All functions are seeded.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.ndimage import (
    gaussian_filter,
    map_coordinates,
    median_filter,
    uniform_filter,
    zoom,
)

from bokehnet.lenses import LensModel, Rays
from bokehnet.raytrace import Camera, render_all_in_focus, render_bokeh, render_disparity
from bokehnet.raytrace.scene import Scene as Planes
from bokehnet.synth import SceneConfig, SynthConfig
from bokehnet.synth.clutter.baked_scene import BakedScene, View
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.config import ClutterConfig
from bokehnet.synth.pairs import lens_for_view
from bokehnet.synth.scenes import random_scene

__all__ = ["CONFIG", "ESTIMATORS", "MAX_RADIUS_PX", "Scene", "layered_scene", "read_scene", "read_scenes"]

# The scenes of the benchmark.
CONFIG = SynthConfig(
    seed=3000017,
    kind="clutter",
    scenes=6,
    width=384,
    height=256,
    bokeh_samples=160,
    image_samples=24,
    scene=SceneConfig(photographs=("coffee", "gravel", "rocket")),
    clutter=ClutterConfig(lamp_probability=0.0),
)

# Factor from the small scenes to pictures of 2560 pixels, and samples per pixel there.
LARGE_FACTOR, _LARGE_SAMPLES = 2560 / CONFIG.width, 8

# Maximum blur radius of the rendered check, pixels.
MAX_RADIUS_PX = 10.0

# Light field: views along each side, and displacement of the outermost view, pixels of the nearest surface.
_VIEWS, _MAX_PARALLAX_PX = 7, 12.0

# Stereo: parallax of the nearest surface, pixels, and standard deviation of the noise of encoded pictures.
_STEREO_PARALLAX_PX, _STEREO_NOISE = 40.0, 0.01

# Noisy stereo maps: window over which neighbours share their error, steps of disparity over the range, and
# fraction of pixels with a wrong match.
_STEREO_WINDOW_PX, _STEREO_STEPS, _WRONG_MATCHES = 5, 512, 0.001

_MIDDLE_GREY = 0.18


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """Picture with its exact map, a picture with bokeh, and views from displaced pupils.

    Attributes:
        name: Name of the scene.
        image: All-in-focus picture, scene-linear, (H, W, 3).
        disparity: Exact disparity, (H, W), 0 to 1.
        truth: Picture with bokeh, (H, W, 3).
        blur: Blur radius per unit of disparity, pixels.
        focus: Disparity in focus.
        views: Light field, (V, V, H, W, 3) float16; empty if not traced.
        stereo: Right-hand picture of a stereo pair, (H, W, 3); empty if not traced.
        parallax: Relative parallax at disparity 0 and at disparity 1.
    """

    name: str
    image: np.ndarray
    disparity: np.ndarray
    truth: np.ndarray
    blur: float
    focus: float
    views: np.ndarray
    stereo: np.ndarray
    parallax: tuple[float, float]


@dataclass(frozen=True, slots=True)
class _DisplacedPinhole:
    """Pinhole camera displaced parallel to its sensor.

    Attributes:
        distance: Distance of the sensor, mm.
        displacement: Displacement to the right and up, mm.
    """

    distance: float
    displacement: tuple[float, float]

    def coc_radius(self, disparity: float) -> float:
        """Return the parallax on the sensor, mm: how far a surface lies from its undisplaced place."""
        return float(np.hypot(*self.displacement)) * self.distance * disparity

    def sample_rays(self, sensor: np.ndarray, disc: np.ndarray) -> Rays:
        """Return the rays from the pinhole, arrays or tensors as ``sensor``; ``disc`` is unused."""
        slope = -sensor / self.distance
        origin = 0 * slope
        origin[..., 0] += self.displacement[0]
        origin[..., 1] += self.displacement[1]
        return Rays(origin=origin, slope=slope)


@dataclass(frozen=True, slots=True)
class _PlaneScene:
    """Scene of planes with the methods of a baked scene."""

    planes: Planes

    def render(self, lens: LensModel, view: View, pupil: bool = True) -> np.ndarray:
        """Return the picture, (H, W, 3); see :meth:`BakedScene.render`."""
        integrate = render_bokeh if pupil else render_all_in_focus
        return np.asarray(integrate(self.planes, _camera(lens, view), view.samples, view.seed))

    def disparity(self, lens: LensModel, view: View) -> np.ndarray:
        """Return inverse depth, 1/mm, (H, W); see :meth:`BakedScene.disparity`."""
        return np.asarray(render_disparity(self.planes, _camera(lens, view)))


def _camera(lens: LensModel, view: View) -> Camera:
    return Camera(lens=lens, width=view.width, height=view.height, pixel_pitch=view.pixel_pitch)


def _random_scene(rng: np.random.Generator, config: SynthConfig) -> BakedScene | _PlaneScene:
    if config.kind == "planes":
        return _PlaneScene(random_scene(rng, config))
    return random_clutter(rng, config).scene


def _view(config: SynthConfig, factor: float, samples: int, seed: int) -> View:
    return View(
        width=round(factor * config.width),
        height=round(factor * config.height),
        pixel_pitch=config.pixel_pitch / factor,
        samples=samples,
        seed=seed,
    )


def _trace(config: SynthConfig, index: int, large: bool) -> dict[str, np.ndarray]:
    """Trace one scene at its small size, or its picture and its map at 2560 pixels."""
    rng = np.random.default_rng(np.random.SeedSequence([config.seed, index]))
    scene = _random_scene(rng, config)
    pinhole = _DisplacedPinhole(config.sensor_distance, (0.0, 0.0))
    small = scene.render(pinhole, _view(config, 1, config.image_samples, 0), False)
    gain = np.float32(_MIDDLE_GREY / max(float(small.mean()), 1e-6))
    inverse_depth = scene.disparity(pinhole, _view(config, 1, 1, 0))
    low, high = float(inverse_depth.min()), float(inverse_depth.max())
    if large:
        size = _view(config, LARGE_FACTOR, _LARGE_SAMPLES, 0)
        values = (scene.disparity(pinhole, size) - low) / (high - low)
        return {"image": gain * scene.render(pinhole, size, False), "disparity": values.astype(np.float32)}
    disparity = ((inverse_depth - low) / (high - low)).astype(np.float32)
    focus = float(np.quantile(disparity, rng.choice([0.1, 0.5, 0.95])))
    blur = MAX_RADIUS_PX / float(np.abs(disparity - focus).max())
    absolute_blur, scaled = blur / (high - low), low + focus * (high - low)
    lens = lens_for_view(absolute_blur, scaled, replace(config, nearest_distance=1.0))
    parallax = config.pixel_pitch / config.sensor_distance / high
    steps = np.linspace(-1, 1, _VIEWS) * _MAX_PARALLAX_PX * parallax

    def displaced(right: float, down: float, samples: int) -> np.ndarray:
        displaced_pinhole = _DisplacedPinhole(config.sensor_distance, (right, down))
        return scene.render(displaced_pinhole, _view(config, 1, samples, 2), False)

    views = [[displaced(float(x), float(y), config.image_samples // 3) for x in steps] for y in steps]
    return {
        "image": gain * small,
        "disparity": disparity,
        "truth": gain * scene.render(lens, _view(config, 1, config.bokeh_samples, 1)),
        "blur": np.float64(blur),
        "focus": np.float64(focus),
        "parallax": np.array([low / high, 1.0]),
        "views": (gain * np.array(views)).astype(np.float16),
        "stereo": gain * displaced(_STEREO_PARALLAX_PX * parallax, 0.0, config.image_samples),
    }


def read_scene(folder: Path, index: int, config: SynthConfig = CONFIG, *, large: bool = False) -> Scene:
    """Return a traced scene; trace it if it is missing in ``folder``.

    Args:
        folder: Cache; delete it after changes of the code that draws scenes.
        index: Number of the scene.
        config: Distribution of the scenes; the scene depends only on it and on ``index``.
        large: True for picture and map at 2560 pixels, without views and picture with bokeh.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{config.seed}-{index}{'-large' if large else ''}.npz"
    if not path.exists():
        np.savez(path.with_suffix(".partial.npz"), **_trace(config, index, large))
        path.with_suffix(".partial.npz").replace(path)
    with np.load(path) as stored:
        arrays = {key: stored[key] for key in stored.files}
    empty = np.zeros(0, np.float32)
    return Scene(
        name=f"scene {index}",
        image=arrays["image"],
        disparity=arrays["disparity"],
        truth=arrays.get("truth", empty),
        blur=float(arrays.get("blur", 0.0)),
        focus=float(arrays.get("focus", 0.0)),
        views=arrays.get("views", empty),
        stereo=arrays.get("stereo", empty),
        parallax=tuple(arrays.get("parallax", (0.0, 1.0))),
    )


def read_scenes(folder: Path, count: int = CONFIG.scenes, *, large: bool = False) -> list[Scene]:
    """Return the first scenes of the benchmark; see :func:`read_scene`."""
    return [read_scene(folder, index, large=large) for index in range(count)]


def layered_scene(kind: str = "discs") -> Scene:
    """Return a thing in focus in front of a wall; the truth is composed of layers.

    Discs and fence have the texture of the wall: the picture shows no edge, so that nothing but the map knows
    where the surfaces end. The railing has colours of its own: wide posts, which all faulty maps keep, and
    wires.

    Args:
        kind: "discs", "fence" or "railing".
    """
    rng = np.random.default_rng(5)
    height, width, radius = 256, 384, 8.0
    y, x = np.mgrid[:height, :width]
    if kind == "discs":
        near = (np.hypot(y % 128 - 64, x % 128 - 64) < 36).astype(np.float32)
    elif kind == "railing":
        near = ((x % 96 < 14) | ((y + x // 12) % 28 < 3)).astype(np.float32)
    else:
        near = (((x + y) % 40 < 4) | ((x - y) % 40 < 4)).astype(np.float32)
    textures = [
        gaussian_filter(rng.standard_normal((height, width, 3)), (1.2, 1.2, 0), mode="wrap") for _ in range(2)
    ]
    front, back = (np.float32(0.25) * np.exp(np.float32(1.5) * t.astype(np.float32)) for t in textures)
    if kind == "railing":
        front = np.float32([0.5, 0.4, 0.25]) * front ** np.float32(0.1)
    edge = int(np.ceil(radius)) + 1
    offsets = np.mgrid[-edge : edge + 1, -edge : edge + 1]
    disc = np.clip(radius + 0.5 - np.hypot(*offsets), 0, 1)
    blurred = np.stack([_convolved(back[..., c], disc / disc.sum()) for c in range(3)], -1)
    return Scene(
        name=kind if kind == "railing" else f"same texture, {kind}",
        image=np.where(near[..., None] > 0, front, back),
        disparity=near,
        truth=np.where(near[..., None] > 0, front, blurred).astype(np.float32),
        blur=radius,
        focus=1.0,
        views=np.zeros(0, np.float32),
        stereo=np.zeros(0, np.float32),
        parallax=(0.0, 1.0),
    )


def _convolved(values: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Return values (H, W) convolved with a kernel, the border repeated."""
    radius = len(kernel) // 2
    padded = np.pad(values, radius, "edge")
    result = np.zeros(values.shape)
    for (row, column), weight in np.ndenumerate(kernel):
        if weight:
            result += weight * padded[row : row + len(values), column : column + values.shape[1]]
    return result


# Estimators: functions of a scene and a random generator that return a map, (H, W), 0 to 1.
Estimator = Callable[[Scene, np.random.Generator], np.ndarray]

# Number of hypotheses of parallax of plane sweep and stereo.
_HYPOTHESES = 64


def _encoded(image: np.ndarray) -> np.ndarray:
    return np.sqrt(np.clip(image.astype(np.float32), 0, 1))


def _relative(scene: Scene, parallax: np.ndarray) -> np.ndarray:
    """Return the disparity of relative parallax, 0 to 1."""
    low, high = scene.parallax
    return np.asarray(np.clip((parallax - low) / (high - low), 0, 1), np.float32)


def _best_hypothesis(costs: np.ndarray, hypotheses: np.ndarray) -> np.ndarray:
    """Return the hypothesis with the lowest cost (N, H, W), refined by a parabola."""
    best = np.clip(costs.argmin(0), 1, len(costs) - 2)
    before, at, after = (np.take_along_axis(costs, (best + k)[None], 0)[0] for k in (-1, 0, 1))
    vertex = np.clip((before - after) / np.maximum(2 * (before - 2 * at + after), 1e-9), -0.5, 0.5)
    step = hypotheses[1] - hypotheses[0]
    return np.asarray(hypotheses[best] + step * vertex, np.float32)


def plane_sweep(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the map by plane sweep over the light field, accurate to a pixel at edges, with small noise.

    The half of the views with the lower cost counts, so that occlusion in the others does not.

    Source:
        Collins, "A space-sweep approach to true multi-image matching", CVPR 1996.
    """
    views, steps = _encoded(scene.views).mean(-1), np.linspace(-1, 1, len(scene.views)) * _MAX_PARALLAX_PX
    views = views + np.float32(0.004) * rng.standard_normal(views.shape, np.float32)
    centre = views[len(views) // 2, len(views) // 2]
    hypotheses, costs = np.linspace(*scene.parallax, _HYPOTHESES), []
    y, x = np.mgrid[: centre.shape[0], : centre.shape[1]]
    for value in hypotheses:
        differences = []
        for i, down in enumerate(steps):
            for j, right in enumerate(steps):
                if i % 2 == 0 and j % 2 == 0 and (i, j) != (len(steps) // 2,) * 2:
                    place = [y - value * down, x - value * right]
                    shifted = map_coordinates(views[i, j], place, order=1, mode="nearest")
                    differences.append(uniform_filter(np.abs(shifted - centre), 3))
        costs.append(np.sort(differences, 0)[: len(differences) // 2].mean(0))
    return _relative(scene, _best_hypothesis(np.array(costs), hypotheses))


def _stereo_costs(scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the absolute differences (N, H, W) of a noisy stereo pair and the parallaxes, pixels."""
    left, right = (
        _encoded(x) + np.float32(_STEREO_NOISE) * rng.standard_normal(x.shape, np.float32)
        for x in (scene.image, scene.stereo)
    )
    shifts = np.arange(int(_STEREO_PARALLAX_PX * scene.parallax[0]), int(_STEREO_PARALLAX_PX) + 2)
    costs = np.full((len(shifts), *left.shape[:2]), 1.0, np.float32)
    for cost, shift in zip(costs, shifts, strict=True):
        cost[:, shift:] = np.abs(left[:, shift:] - right[:, : left.shape[1] - shift]).mean(-1)
    return np.minimum(costs, 0.12), shifts


def _from_stereo(scene: Scene, costs: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the map of the best parallaxes; occluded pixels get the background beside them."""
    parallax = _best_hypothesis(costs, shifts.astype(np.float32))
    # The right-hand map follows from the same costs, along the other diagonal.
    columns = np.arange(costs.shape[2])
    other = np.array([costs[k][:, np.minimum(columns + s, columns[-1])] for k, s in enumerate(shifts)])
    reverse = shifts[other.argmin(0)]
    rows = np.arange(costs.shape[1])[:, None]
    partner = np.clip(columns - np.rint(parallax).astype(int), 0, columns[-1])
    occluded = np.abs(reverse[rows, partner] - parallax) > 1.5
    filled = np.where(occluded, np.nan, parallax)
    for line in filled:
        known = np.flatnonzero(np.isfinite(line))
        if len(known):
            after = np.searchsorted(known, columns)
            before = line[known[np.clip(after - 1, 0, len(known) - 1)]]
            behind = np.minimum(before, line[known[np.clip(after, 0, len(known) - 1)]])
            line[:] = np.where(np.isnan(line), behind, line)
        else:
            line[:] = shifts[0]
    return _relative(scene, median_filter(filled, 3) / _STEREO_PARALLAX_PX)


def block_matching(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the map by block matching in windows of 9 pixels, which fatten foregrounds by half a window.

    Source:
        Scharstein and Szeliski, "A taxonomy and evaluation of dense two-frame stereo correspondence
        algorithms", IJCV 2002.
    """
    costs, shifts = _stereo_costs(scene, rng)
    return _from_stereo(scene, np.array([uniform_filter(cost, 9) for cost in costs]), shifts)


def semi_global_matching(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the map by semi-global matching along four paths.

    Source:
        Hirschmüller, "Stereo processing by semiglobal matching and mutual information", IEEE TPAMI 2008.
    """
    costs, shifts = _stereo_costs(scene, rng)
    costs = np.array([uniform_filter(cost, 3) for cost in costs])
    total = np.zeros_like(costs)
    for axis in (1, 2):
        for direction in (1, -1):
            lines = np.moveaxis(costs, axis, 0)[::direction]  # (steps, N, lines)
            summed, previous = np.empty_like(lines), lines[0]
            summed[0] = previous
            for at in range(1, len(lines)):
                lowest = previous.min(0)
                neighbours = np.pad(previous, ((1, 1), (0, 0)), constant_values=np.inf)
                jump = np.minimum(np.minimum(neighbours[:-2], neighbours[2:]) + 0.02, lowest + 0.15)
                previous = lines[at] + np.minimum(previous, jump) - lowest
                summed[at] = previous
            total += np.moveaxis(summed[::direction], 0, axis)
    return _from_stereo(scene, total, shifts)


def sparse_lidar(scene: Scene, rng: np.random.Generator, *, linear: bool = True) -> np.ndarray:
    """Return the map of points on every fifth row and fourth column, densified by interpolation."""
    height, width = scene.disparity.shape
    y, x = (grid.ravel() for grid in np.mgrid[2:height:5, 1:width:4])
    x = np.clip(x + rng.integers(-1, 2, len(x)), 0, width - 1)
    values = scene.disparity[y, x] * (1 + 0.002 * rng.standard_normal(len(x)))
    grid = np.mgrid[:height, :width]
    nearest = NearestNDInterpolator(np.stack([y, x], 1), values)(*grid)
    if not linear:
        return np.asarray(np.clip(nearest, 0, 1), np.float32)
    inside = LinearNDInterpolator(np.stack([y, x], 1), values)(*grid)
    return np.asarray(np.clip(np.where(np.isnan(inside), nearest, inside), 0, 1), np.float32)


def time_of_flight(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the map of a sensor with a quarter of the resolution and 1 % noise, enlarged."""
    height, width = scene.disparity.shape
    small = zoom(uniform_filter(scene.disparity, 4), 0.25, order=1)
    small = small + 0.01 * rng.standard_normal(small.shape)
    large = zoom(small, (height / small.shape[0], width / small.shape[1]), order=1)
    return np.asarray(np.clip(large, 0, 1), np.float32)


def eight_bit(scene: Scene, _: np.random.Generator) -> np.ndarray:
    """Return the exact map in 256 levels."""
    return np.asarray(np.rint(255 * scene.disparity) / 255, np.float32)


def exact(scene: Scene, _: np.random.Generator) -> np.ndarray:
    """Return the exact map."""
    return scene.disparity


def with_missing_band(scene: Scene, _: np.random.Generator) -> np.ndarray:
    """Return the exact map without values, 0, in a band of 24 columns and one of 16 rows."""
    values = scene.disparity.copy()
    values[:, 150:174], values[180:196] = 0, 0
    return values


def with_outliers(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the exact map with random values in 0.3 % of the pixels."""
    places = rng.random(scene.disparity.shape) < 0.003
    return np.where(places, rng.random(scene.disparity.shape), scene.disparity).astype(np.float32)


def random_map(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return a map of random blobs without relation to the picture."""
    smooth = gaussian_filter(rng.standard_normal(scene.disparity.shape), 10)
    return np.asarray(np.digitize(smooth / smooth.std(), [-0.7, 0, 0.9]) / 3, np.float32)


def with_stereo_noise(disparity: np.ndarray, rng: np.random.Generator, deviation: float) -> np.ndarray:
    """Return a map with the noise of stereo matching: shared by a window, in steps, with some wrong matches.

    Args:
        disparity: Map without noise, (H, W).
        rng: Source of the noise.
        deviation: Standard deviation of the noise of correct matches, as a fraction of the range of the map.
    """
    low, span = disparity.min(), max(np.ptp(disparity), 1e-9)
    noise = _STEREO_WINDOW_PX * uniform_filter(rng.standard_normal(disparity.shape), _STEREO_WINDOW_PX)
    noisy = np.rint(_STEREO_STEPS * ((disparity - low) / span + deviation * noise)) / _STEREO_STEPS
    is_wrong = rng.random(disparity.shape) < _WRONG_MATCHES
    noisy[is_wrong] = rng.random(int(is_wrong.sum()))
    result: np.ndarray = (low + span * np.clip(noisy, 0, 1)).astype(np.float32)
    return result


def stereo_noise(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the exact map with the noise of stereo matching, of 1.5 % of its range."""
    return with_stereo_noise(scene.disparity, rng, 0.015)


ESTIMATORS: Mapping[str, Estimator] = {
    "exact": exact,
    "8 bits": eight_bit,
    "plane sweep": plane_sweep,
    "block matching": block_matching,
    "semi-global matching": semi_global_matching,
    "lidar, nearest": partial(sparse_lidar, linear=False),
    "lidar, linear": sparse_lidar,
    "time of flight": time_of_flight,
    "missing bands": with_missing_band,
    "outliers": with_outliers,
    "stereo noise": stereo_noise,
    "random": random_map,
}
