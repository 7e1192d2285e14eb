"""Measurements of thesis 002: ``python -m benchmarks.experiments.theses.jeong``.

Table 4.1: time over lens samples, of one colour and with dispersion. 4.4.2: light of the spectrum outside
400 to 700 nm. Figures 5.7 and 5.8: merged lights, high and low quality, by stage. Figure 5.9: profile
textures by the printed mapping and by ours. 3.6: levels of detail for motion blur. ``--figures DIR`` writes
all as JSON files.
"""

from functools import partial

import numpy as np

from benchmarks.experiments.edges.level_of_detail import ball
from benchmarks.experiments.theses.bokehlab import report
from benchmarks.measurement import processor_seconds
from bokehnet.baselines.rays.mesh_views import MeshObject, Picture, draw, render_views
from bokehnet.baselines.rays.motion_levels import moving_views
from bokehnet.baselines.spread.merged_lights import merge_lights, splat_sources
from bokehnet.lenses import ThinLens
from bokehnet.lenses.aberrations.point_spread import PsfGrid, correlation, psf_radius, traced_psf
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.lookup.printed_mappings import printed_row
from bokehnet.lenses.lookup.profile_texture import profile_psf, profile_row, trace_profile_texture
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.spectral import spectrum
from bokehnet.optics.spectral.glass import make_glass
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from train.scores.metrics import encode, psnr, similarity

_COMMAND = "python -m benchmarks.experiments.theses.jeong --figures docs/figures"

_PICTURE = Picture(width=320, height=180, pixel_pitch=36 / 320)
_LENS = ThinLens(focal_length=50.0, f_number=1.4, focus_distance=1500.0)

_MAX_SAMPLES = 64

# Wavelength of the lens's nominal focal length, nm, and lateral magnification per nm at the corner.
_REFERENCE_NM, _LATERAL_PER_NM = 650.0, 2e-5
_HALF_DIAGONAL_MM = float(np.hypot(36, 36 * 9 / 16)) / 2


def _balls(count: int) -> list[MeshObject]:
    depths = np.geomspace(700, 4000, count)
    return [ball((0.1 * z * (-1) ** k, 0.0, float(z)), 0.1 * z, k) for k, z in enumerate(depths)]


def samples() -> dict[str, dict[str, float]]:
    """Return processor milliseconds of views by number of lens samples, of one colour and with dispersion."""
    objects = _balls(2)
    rows = {}
    for count in (1, 4, 16, _MAX_SAMPLES):
        plain = 1000 * processor_seconds(partial(render_views, objects, _LENS, _PICTURE, count), 5)
        dispersed = 1000 * processor_seconds(partial(_dispersed_views, objects, count), 5)
        rows[f"{count} samples"] = {
            "ms": plain,
            "each": plain / count,
            "dispersed": dispersed,
            "dispersed_each": dispersed / count,
        }
    return rows


def _dispersed_views(objects: list[MeshObject], count: int) -> np.ndarray:
    """Return the mean (H, W, 3) of views with a point of the pupil and a wavelength each: 4.2.2.

    The focus of a wavelength is (4.5) with N-BK7, the magnification (4.8), both relative to 650 nm.
    """
    points = disc_from_square(np.stack([halton(count, 2), halton(count, 7)], -1)) * _LENS.pupil_radius
    wavelengths, weights = WavelengthSampling().at(halton(_MAX_SAMPLES, 11) + 0.5 / _MAX_SAMPLES)
    glass = make_glass("N-BK7")
    powers = (glass.index(wavelengths) - 1) / (glass.index(_REFERENCE_NM) - 1) / _LENS.focal_length
    inverse_focus = powers - 1 / _LENS.sensor_distance
    scale = _LENS.sensor_distance / _PICTURE.pixel_pitch
    mean = np.zeros((_PICTURE.height, _PICTURE.width, 3))
    for (x, y), wavelength, weight, inverse_distance in zip(
        points, wavelengths[:count], weights[:count], inverse_focus[:count], strict=True
    ):
        light = np.zeros(mean.shape, np.float32)
        inverse = np.zeros(mean.shape[:2], np.float32)
        shift = x * inverse_distance * scale, y * inverse_distance * scale
        for mesh in objects:
            corners, colors, faces = mesh.levels[0]
            field = np.hypot(*corners.T[:2]) / corners[:, 2] * _LENS.sensor_distance / _HALF_DIAGONAL_MM
            magnified = corners.copy()
            magnified[:, :2] *= (1 + _LATERAL_PER_NM * (_REFERENCE_NM - wavelength) * field)[:, None]
            middle = _PICTURE.width / 2 + shift[0], _PICTURE.height / 2 + shift[1]
            draw(magnified, colors, faces, scale, *middle, x, y, light, inverse)
        mean += light * weight
    return mean / count


def spectrum_ends() -> dict[str, dict[str, float]]:
    """Return the light of each channel outside 400 to 700 nm, of a flat spectrum from 380 to 780 nm."""
    nm = np.linspace(380, 780, 40001)
    light = np.abs(spectrum.wavelength_color(nm))
    inside = (nm >= 400) & (nm <= 700)
    lost = 1 - light[inside].sum(0) / light.sum(0)
    return {
        name: {"percent": 100 * float(part)}
        for name, part in zip(("red", "green", "blue"), lost, strict=True)
    }


def _lights(count: int, clusters: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    centers = np.stack([rng.uniform(-900, 900, clusters), rng.uniform(-450, 450, clusters)], -1)
    place = centers[rng.integers(clusters, size=count)] + rng.normal(0, 12, (count, 2))
    return np.concatenate([place, np.full((count, 1), 4000.0)], 1), rng.uniform(0.5, 2.0, (count, 3))


def _leaves(point: np.ndarray, pupil: np.ndarray) -> np.ndarray:
    """Return the distance of the leaf in front of each pupil point: a grid of discs at 900 mm."""
    at = pupil + (point[:2] - pupil) * 900.0 / point[2]
    blocked = (np.mod(at, 24.0) ** 2).sum(-1) < 15.0**2
    return np.where(blocked, 900.0, np.inf)


def merged() -> dict[str, dict[str, float]]:
    """Return seconds of all lights and of merged ones, the speed-up and the quality."""
    radius = _LENS.pupil_radius
    scale = _LENS.sensor_distance / _PICTURE.pixel_pitch

    def blur(position: np.ndarray) -> tuple[float, float, float]:
        column, row = _PICTURE.width / 2 + position[0] / position[2] * scale, _PICTURE.height / 2
        row += position[1] / position[2] * scale
        return column, row, float(_LENS.coc_radius(1 / position[2])) / _PICTURE.pixel_pitch * 3

    size = (_PICTURE.height, _PICTURE.width)
    rows = {}
    for name, count, fraction in (
        ("many lights", 800, 0.049),
        ("lights", 400, 0.09),
        ("few lights", 150, 0.21),
    ):
        positions, lights = _lights(count, max(4, round(count * fraction)), count)
        points, _ = merge_lights(positions, lights, count)
        merge = partial(merge_lights, positions, lights, max(1, round(count * fraction)))
        sources, _ = merge()
        splat_all, splat_merged = (
            partial(splat_sources, each, _leaves, radius, blur, size) for each in (points, sources)
        )
        exact, picture = splat_all(), splat_merged()
        full, merging = processor_seconds(splat_all, 5), processor_seconds(merge, 5)
        quick = merging + processor_seconds(splat_merged, 5)
        peak = float(np.quantile(exact, 0.999))
        truth, result = (encode(each / peak) for each in (exact, picture))
        rows[f"{name}, {count} to {len(sources)}"] = {
            "high": full,
            "low": quick,
            "merge": merging,
            "speed": full / quick,
            "psnr": psnr((truth - result) ** 2),
            "ssim": similarity(truth, result)[0],
        }
    return rows


def profiles() -> dict[str, dict[str, float]]:
    """Return the correlation of textures' blurs with traced ones, by lens and distance, on the axis."""
    rows = {}
    wavelengths, colors = WavelengthSampling().sample(12)
    for name in ("biconvex", "cooke_triplet", "double_gauss", "telephoto"):
        lens = load_lens(name)
        focus, focal = lens.focus_distance, lens.focal_length
        if not np.isfinite(focus):
            focus = 50 * focal
            lens = load_lens(name, focus_distance=focus)
        texture = trace_profile_texture(lens, farthest=0.12 * focal)
        for factor in (0.5, 0.8, 1.5, 3.0):
            depth = factor * focus
            pitch = 2.5 * psf_radius(lens, depth, (0.0, 0.0)) / 64
            traced = traced_psf(
                lens,
                PsfGrid(wavelengths=wavelengths, colors=colors, pitch=pitch, size=64, rays=6000),
                depth=depth,
                field=(0.0, 0.0),
            )
            result = np.array([profile_row(texture, lens, depth, float(nm)) for nm in wavelengths])
            sharpest = profile_row(texture, lens, focus)
            printed = np.array([printed_row(lens, depth, float(nm), sharpest) for nm in wavelengths])
            rows[f"{name}, {factor:g} of the focus"] = {
                kind: correlation(traced, profile_psf(texture, plane, colors, pitch, 64))
                for kind, plane in (("ours", result), ("printed", printed))
            }
    return rows


def motion() -> dict[str, dict[str, float]]:
    """Return seconds, triangles and quality of moving balls with and without levels."""
    objects = [(mesh, np.array([40.0, 0.0, 0.0])) for mesh in _balls(4)]
    truth = encode(moving_views(objects, _LENS, _PICTURE, 128, levels=False).bokeh)
    rows = {}
    variants = {"finest level": {"levels": False}, "levels": {}, "levels, 2 finer": {"finer": 2.0}}
    for name, options in variants.items():
        run = partial(moving_views, objects, _LENS, _PICTURE, 32, **options)
        result = run()
        encoded = encode(result.bokeh)
        rows[name] = {
            "seconds": processor_seconds(run, 5),
            "triangles": result.triangles / 1e6,
            "psnr": psnr((encoded - truth) ** 2),
            "ssim": similarity(truth, encoded)[0],
        }
    return rows


_MEASUREMENTS = {
    "jeong_samples": (
        samples,
        "262,144 triangles, 320x180 pixels, processor time, medians of 5",
        {
            "ms": ("one colour, ms", ".0f"),
            "each": ("ms a sample", ".1f"),
            "dispersed": ("dispersion, ms", ".0f"),
            "dispersed_each": ("ms a sample", ".1f"),
        },
    ),
    "jeong_spectrum": (
        spectrum_ends,
        "flat spectrum from 380 to 780 nm",
        {"percent": ("light outside 400 to 700 nm, %", ".2f")},
    ),
    "jeong_merged": (
        merged,
        "lights at 4 m behind leaves at 0.9 m, 320x180 pixels, processor seconds, medians of 5",
        {
            "high": ("all lights, s", ".2f"),
            "low": ("merged, s", ".2f"),
            "merge": ("of which merging, s", ".2f"),
            "speed": ("speed-up", ".1f"),
            "psnr": ("PSNR", ".1f"),
            "ssim": ("SSIM", ".3f"),
        },
    ),
    "jeong_profiles": (
        profiles,
        "on the axis; correlation with the traced blur",
        {"printed": ("mapping (5.6) to (5.9)", ".3f"), "ours": ("our mapping", ".3f")},
    ),
    "jeong_motion": (
        motion,
        "four balls of 131,072 triangles, 32 views, 320x180 pixels, against 128 views of all triangles; "
        "processor seconds, medians of 5",
        {
            "seconds": ("seconds", ".2f"),
            "triangles": ("million triangles", ".2f"),
            "psnr": ("PSNR", ".2f"),
            "ssim": ("SSIM", ".3f"),
        },
    ),
}


def main() -> None:
    """Entry of the command line."""
    report(_MEASUREMENTS, _COMMAND, __doc__)


if __name__ == "__main__":
    main()
