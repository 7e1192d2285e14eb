"""Measurements of thesis 000, chapter 3: ``python -m benchmarks.experiments.theses.marsicano``.

3.3: noise of stratified wavelength clusters. 3.4: rings of polishing. 3.10.5: pictures of lights by Seidel
aberrations against pictures traced through the lens, RMSE and MS-SSIM, with the subsets of three parameters.
6.0.2: rays that fill what motion uncovers. ``--figures DIR`` writes all as JSON files.
"""

from dataclasses import replace
from functools import cache
from itertools import combinations
from time import process_time

import numpy as np
import torch

from benchmarks.experiments.theses.bokehlab import report
from bokehnet.baselines.rays.motion_rays import fill_motion, motion_blur, motion_edges
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.lenses.aberrations.point_spread import PsfGrid, aberration_psf, psf_radius, traced_psf
from bokehnet.lenses.aberrations.polishing import PolishedSurface, polished_psf
from bokehnet.lenses.aberrations.psf_pairs import FIELDS, psf_depths
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.seidel_lens import SeidelLens, reduce_lens
from bokehnet.optics.aberrations.seidel import SeidelCoefficients
from bokehnet.optics.spectral.spectrum import wavelength_color
from bokehnet.optics.spectral.wavelength_clusters import cluster_colors, reduced_cluster, stratified_clusters
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.scenes.reader import read_scene
from train.scores.metrics import encode, psnr

_COMMAND = "python -m benchmarks.experiments.theses.marsicano --figures docs/figures"

# The seven parameters: five Seidel sums, axial and lateral colour.
_PARAMETERS = ("spherical", "coma", "astigmatism", "field_curvature", "distortion", "axial", "lateral")
# Those that change the shape of a blur: distortion moves it.
_IN_BLUR = tuple(name for name in _PARAMETERS if name != "distortion")
_LENSES = ("biconvex", "cooke_triplet", "double_gauss")
_SIZE, _RAYS, _WAVELENGTHS = 64, 2000, 8
# Rays a pixel of motion blur, and of its truth.
_MOVING_SCENE, _MOTION_RAYS, _MOTION_TRUTH = "configs/scene_balls.toml", 64, 512


def clusters() -> dict[str, dict[str, float]]:
    """Return the RMS error of the colour of light by kind of sampling, 64 rays a pixel."""
    rng = np.random.default_rng(0)
    fine = np.linspace(400, 700, 6001)

    def light(nm: np.ndarray) -> np.ndarray:
        return 1 + 0.8 * np.sin(nm / 30)

    truth = (wavelength_color(fine) * light(fine)[:, None]).mean(0)
    pixels, rays, size = 400, 64, 8
    errors: dict[str, list[float]] = {name: [] for name in ("cluster", "reduced", "random", "importance")}
    for _ in range(pixels):
        result = stratified_clusters(rays, size, rng)
        single, uniform = reduced_cluster(result, rng), rng.uniform(400, 700, rays)
        nm, weights = WavelengthSampling().at((np.arange(rays) + rng.random(rays)) / rays)
        estimates = {
            "cluster": cluster_colors(result, light(result)).mean(0),
            "reduced": (wavelength_color(single) * light(single)[:, None]).mean(0),
            "random": (wavelength_color(uniform) * light(uniform)[:, None]).mean(0),
        }
        for name, value in estimates.items():
            errors[name].append(float(((value - truth) ** 2).mean()))
        clipped = WavelengthSampling().response(fine)
        expected = (clipped * light(fine)[:, None]).mean(0)
        errors["importance"].append(float((((weights * light(nm)[:, None]).mean(0) - expected) ** 2).mean()))
    titles = {
        "cluster": "clusters of 8, no dispersion",
        "reduced": "clusters reduced to one wavelength",
        "random": "one random wavelength",
        "importance": "one wavelength by importance (ours)",
    }
    return {titles[name]: {"rms": 100 * float(np.sqrt(np.mean(values)))} for name, values in errors.items()}


def polishing() -> dict[str, dict[str, float]]:
    """Return the contrast of the rings of a disc of 30 pixels, by height of the grooves."""
    rows = {}
    for height in (0.0, 5.0, 15.0, 30.0, 60.0):
        psf = polished_psf(PolishedSurface(ring_height=height, noise_height=0), 30.0, 0.006, 60.0)
        half = len(psf) // 2
        y, x = np.mgrid[-half : half + 1, -half : half + 1]
        distance = np.rint(np.hypot(x, y)).astype(int).ravel()
        light = (np.bincount(distance, psf.ravel()) / np.bincount(distance))[3:27]
        rows[f"grooves of {height:g} nm"] = {"contrast": 100 * float(light.std() / light.mean())}
    return rows


def motion() -> dict[str, dict[str, float]]:
    """Return quality and processor seconds of motion blur by post-process, by rays, and by both."""
    scene = read_scene(_MOVING_SCENE, {"camera.width": 240, "camera.height": 160})
    tracer = scene.tracer()
    truth = encode(tracer.render(_MOTION_TRUTH).all_in_focus.numpy())
    still = replace(scene, shutter=0.0).tracer().render(_MOTION_RAYS).all_in_focus.numpy()
    maps, camera = tracer.maps(), scene.camera
    velocity = np.array([body.velocity for body in scene.world.bodies] + [(0.0, 0.0, 0.0)])
    scale = scene.shutter * camera.lens.sensor_distance / camera.pixel_pitch
    displacement = velocity[maps.body.numpy()][..., :2] * scale / maps.depth.numpy()[..., None]
    displacement = np.nan_to_num(displacement)

    def traced(pixels: np.ndarray) -> np.ndarray:
        sums = np.zeros((len(pixels), 3))
        place = 0
        for part, values in tracer.trace(torch.from_numpy(pixels), 0, _MOTION_RAYS):
            sums[place : place + len(part)] = values[..., 3:6].mean(0).numpy()
            place += len(part)
        return sums

    everywhere = np.arange(still.shape[0] * still.shape[1])
    ways = {
        "post-process": lambda: motion_blur(still, displacement),
        "with rays at edges of motion": lambda: fill_motion(still, displacement, traced),
        "rays everywhere": lambda: traced(everywhere).reshape(still.shape),
    }
    mask = motion_edges(displacement)
    rows = {}
    for name, render in ways.items():
        start = process_time()
        picture = render()
        seconds = process_time() - start
        error = (encode(np.asarray(picture, np.float32)) - truth) ** 2
        rows[name] = {"edges": psnr(error[mask]), "psnr": psnr(error), "seconds": seconds}
    return rows


def _subset(lens: SeidelLens, kept: tuple[str, ...]) -> SeidelLens:
    """Return the lens with all parameters but some set to 0, in the picture and in the pupil."""
    sums = [name for name in _PARAMETERS[:5] if name not in kept]
    image, pupil = (_without(part, sums) for part in (lens.image, lens.pupil))
    zero = np.zeros_like(lens.blur)
    return replace(
        lens,
        image=image,
        pupil=pupil,
        blur=lens.blur if "axial" in kept else zero,
        shift=lens.shift if "lateral" in kept else zero,
    )


def _without(coefficients: SeidelCoefficients, names: list[str]) -> SeidelCoefficients:
    """Return coefficients without those of some aberrations."""
    return replace(coefficients, **{name: 0 * getattr(coefficients, name) for name in names})


@cache
def _traced(name: str) -> tuple[PrescriptionLens, list[tuple[float, float, float, np.ndarray]]]:
    """Return a lens, and depth, field, pitch and traced image of nine lights."""
    lens = load_lens(name, focusing="paraxial")
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    lights = []
    for depth in psf_depths(lens):
        for field in FIELDS:
            pitch = 2.5 * max(psf_radius(lens, depth, (field, 0.0)), 1e-3) / _SIZE
            image = traced_psf(
                lens,
                PsfGrid(wavelengths=wavelengths, colors=colors, pitch=pitch, size=_SIZE, rays=_RAYS),
                depth=depth,
                field=(field, 0.0),
            )
            lights.append((depth, field, pitch, image))
    return lens, lights


@cache
def _reduced(name: str) -> tuple[SeidelLens, SeidelLens]:
    """Return the third-order description of a lens at all wavelengths, and at the design wavelength."""
    lens = _traced(name)[0]
    wavelengths = np.sort(WavelengthSampling().sample(_WAVELENGTHS)[0])
    design = [lens.prescription.design_wavelength]
    return reduce_lens(lens, wavelengths=[float(nm) for nm in wavelengths]), reduce_lens(
        lens, wavelengths=design
    )


def _scores(name: str, kept: tuple[str, ...]) -> tuple[float, float]:
    """Return RMSE and MS-SSIM of the picture of nine lights."""
    import torch
    from pytorch_msssim import ms_ssim

    lens, lights = _traced(name)
    both = _reduced(name)
    radius = lens.prescription.image_radius
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    reduced, design = (_subset(each, kept) for each in both)
    aberration_map = reduced.aberration_map(design)
    pictures: list[list[np.ndarray]] = [[], []]
    for depth, field, pitch, traced in lights:
        image = aberration_psf(
            aberration_map,
            PsfGrid(wavelengths=wavelengths, colors=colors, pitch=pitch / radius, size=_SIZE, rays=_RAYS),
            defocus=float(lens.coc_radius(1 / depth)) / radius,
            field=(field, 0.0),
        )
        peak = np.quantile(traced.max(-1), 0.98)
        for cells, each in zip(pictures, (traced, image), strict=True):
            cells.append(linear_to_srgb(np.clip(each / peak, 0, 1)))
    truth, picture = (
        np.vstack([np.hstack(cells[3 * row : 3 * row + 3]) for row in range(3)]) for cells in pictures
    )
    planes = (np.moveaxis(each, -1, 0)[None].astype(np.float32) for each in (picture, truth))
    tensors = [torch.from_numpy(np.ascontiguousarray(each)) for each in planes]
    return float(np.sqrt(((picture - truth) ** 2).mean())), float(ms_ssim(*tensors, data_range=1.0))


def seidel() -> dict[str, dict[str, float]]:
    """Return RMSE and MS-SSIM by lens: Gaussian optics, all seven parameters, and the best three."""
    rows = {}
    for name in _LENSES:
        triples = {kept: _scores(name, kept) for kept in combinations(_IN_BLUR, 3)}
        best = min(triples, key=lambda kept: triples[kept][0])
        kinds = {
            "Gaussian optics": (),
            "seven parameters": _PARAMETERS,
            f"best three: {', '.join(best)}": best,
        }
        for label, kept in kinds.items():
            rmse, similarity = triples[kept] if kept in triples else _scores(name, kept)
            rows[f"{name}, {label}"] = {"rmse": rmse, "ms_ssim": similarity}
    return rows


_MEASUREMENTS = {
    "marsicano_clusters": (
        clusters,
        "64 rays a pixel, 400 pixels",
        {"rms": ("RMS error of colour, %", ".2f")},
    ),
    "marsicano_polishing": (
        polishing,
        "disc of 30 px, pixels of 6 micrometres, pupil 60 mm from the sensor, 12 grooves",
        {"contrast": ("RMS contrast of its rings, %", ".1f")},
    ),
    "marsicano_motion": (
        motion,
        "a rolling ball, 240x160 pixels, pinhole, 64 rays a pixel; edges: pixels that a moving edge reaches",
        {
            "edges": ("PSNR at edges", ".2f"),
            "psnr": ("PSNR", ".2f"),
            "seconds": ("processor seconds", ".2f"),
        },
    ),
    "marsicano_seidel": (
        seidel,
        "nine lights at three depths and fields, traced through the lens as Kolb has it; sRGB",
        {"rmse": ("RMSE", ".4f"), "ms_ssim": ("MS-SSIM", ".4f")},
    ),
}


def main() -> None:
    """Entry of the command line."""
    report(_MEASUREMENTS, _COMMAND, __doc__)


if __name__ == "__main__":
    main()
