"""Pictures through real lenses: ``rays`` with an aberration map compared with ray tracing through the glass.

The scene has tilted textured planes at several depths. The input of ``rays`` is the picture and depth of the
strongly stopped-down lens. The traced picture is divided by that of a white scene, because renderers do not
darken corners. Run ``python -m benchmarks.experiments.lenses.lens_pictures``.
"""

import argparse
import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from bokehnet.checks import Array
from bokehnet.classical.rays_renderer import rays
from bokehnet.io.image import write_image
from bokehnet.lenses import LensModel, PrescriptionLens, Rays, load_lens
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.raytrace import Camera, Plane, Scene, Tracer, background_from, plane_texture, world_from_scene
from bokehnet.raytrace.surfaces.textures import checkers, dead_leaves, fractal_colours, glyph_page
from bokehnet.tools.contact_sheet import contact_sheet
from train.scores.metrics import edge_pixels, encode, psnr

__all__ = ["LensCase", "main", "score", "trace_case"]

_LENSES = ("double_gauss", "petzval", "retrofocus")
_FOCUS = 30.0  # focal lengths
# Maximum blur radius in half-diagonals, near and far.
_BLUR = 0.04
_WAVELENGTHS = 24


@dataclass(frozen=True, kw_only=True)
class _OneColor:
    """Lens for light of one wavelength, nm."""

    lens: PrescriptionLens
    wavelength: float | None

    def coc_radius(self, disparity: Array) -> Array:
        return self.lens.coc_radius(disparity)

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        return self.lens.sample_rays(sensor_xy, pupil_uv, self.wavelength, sensor_offset)


class _StoppedDown:
    """Stopped-down lens: rays through the centre of the stop, from a table over the radius."""

    def __init__(self, lens: PrescriptionLens) -> None:
        radius = np.linspace(0, 1.1 * lens.prescription.image_radius, 2000)
        chief = chief_rays(lens, np.stack([radius, 0 * radius], -1))
        self._lens = lens
        # Per unit of radius, as rays rotate with the direction of the sensor point.
        self._radius, self._origin, self._slope = (
            radius[1:],
            chief.origin[1:, 0] / radius[1:],
            chief.slope[1:, 0] / radius[1:],
        )

    def coc_radius(self, disparity: Array) -> Array:
        return self._lens.coc_radius(disparity)

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        radius = sensor_xy.norm(dim=-1).numpy()
        origin, slope = (
            -sensor_xy * torch.from_numpy(np.interp(radius, self._radius, row)).to(sensor_xy.dtype)[..., None]
            for row in (self._origin, self._slope)
        )
        return Rays(origin=origin, slope=slope)


def _make_scene(lens: PrescriptionLens, camera: Camera, rng: np.random.Generator) -> Scene:
    """Return five planes and a backdrop that fill the picture; texels are about two pixels wide."""
    half = np.array([camera.width, camera.height]) * camera.pixel_pitch / 2 / lens.sensor_distance
    diagonal = math.hypot(camera.width, camera.height) * camera.pixel_pitch / 2
    step = _BLUR * diagonal / (lens.thick.pupil_radius * lens.sensor_distance)
    focus = 1 / lens.focus_distance
    behind = min(step, 0.9 * focus)  # wide-angle lenses blur infinity by less

    def plane(
        blur: float,
        position: tuple[float, float],
        size: tuple[float, float],
        tilt: tuple[float, float],
        paint: Callable[[int, int, np.random.Generator], np.ndarray],
    ) -> Plane:
        """Return a plane; blur in steps, position and half size in half pictures, tilt in depths."""
        depth = 1 / (focus + blur * (step if blur > 0 else behind))
        texels = [
            max(8, int(length * extent / 2))
            for length, extent in zip(size, (camera.width, camera.height), strict=True)
        ]
        x, y = np.array(position) * half * depth
        return Plane(
            texture=plane_texture(_stretch(paint(texels[1], texels[0], rng))),
            centre=(x, y, depth),
            u_axis=(size[0] * half[0] * depth, 0.0, tilt[0] * depth),
            v_axis=(0.0, size[1] * half[1] * depth, tilt[1] * depth),
        )

    texture = _stretch(dead_leaves(camera.height, camera.width, rng, fractal_colours))
    return Scene(
        background=background_from(texture, (2.0 * half[0], 2.0 * half[1]), focus - behind),
        planes=(
            plane(-0.3, (0.0, 0.75), (1.3, 0.4), (0.0, -0.3), fractal_colours),
            plane(-0.1, (-0.5, -0.35), (0.42, 0.5), (0.25, 0.0), dead_leaves),
            plane(0.0, (0.35, -0.2), (0.4, 0.45), (-0.1, 0.1), glyph_page),
            plane(0.4, (-0.75, 0.4), (0.3, 0.35), (0.0, 0.1), checkers),
            plane(0.8, (0.75, 0.55), (0.28, 0.5), (0.05, 0.0), fractal_colours),
        ),
    )


def _stretch(texture: np.ndarray) -> np.ndarray:
    """Return a texture (H, W, 3) with each colour stretched from nearly black to nearly white."""
    low, high = np.quantile(texture, [0.01, 0.99], axis=(0, 1))
    stretched: np.ndarray = np.clip((texture - low) / np.maximum(high - low, 1e-6), 0.02, 0.98)
    return stretched.astype(np.float32)


def _camera(lens: LensModel, width: int, height: int, half_diagonal: float) -> Camera:
    pitch = 2 * half_diagonal / math.hypot(width, height)
    return Camera(lens=lens, width=width, height=height, pixel_pitch=pitch)


def _trace(scene: Scene, lens: PrescriptionLens, camera: Camera, samples: int, seed: int) -> np.ndarray:
    """Return the traced picture relative to that of a white scene; ``samples`` of each wavelength."""
    white = Scene(background=background_from(np.ones((2, 2, 3), np.float32), (1.0, 1.0)))
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    total = light = 0.0
    for number, (wavelength, color) in enumerate(zip(wavelengths, colors, strict=True)):
        one = dataclasses.replace(camera, lens=_OneColor(lens=lens, wavelength=float(wavelength)))
        picture, white_picture = (
            Tracer(world_from_scene(part), one, seed=seed + number).render(samples).bokeh.numpy()
            for part in (scene, white)
        )
        total, light = total + color * picture, light + color * white_picture
    return total / light


def score(picture: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """Return the PSNR inside ``mask``, and of the whole picture, dB."""
    squared = (encode(picture) - encode(truth)) ** 2
    return psnr(squared[mask]), psnr(squared)


def _inner(defocus: np.ndarray, reach: float) -> np.ndarray:
    """Return the mask of pixels out of reach of depth edges and of the border, (H, W) bool.

    ``reach`` is the spread of light beyond the blur radius, pixels; a third of the radius is added.
    """
    wider = 1.3 * defocus + np.copysign(reach, defocus)
    inner = ~edge_pixels(wider.astype(np.float32))
    border = math.ceil(np.abs(wider).max())
    inner[:border] = inner[-border:] = inner[:, :border] = inner[:, -border:] = False
    return inner


@dataclass(frozen=True, kw_only=True)
class LensCase:
    """Picture through a lens, and the input of a renderer that shall make it.

    Attributes:
        lens: The lens, focused at 30 focal lengths.
        pixel_pitch: Pixel pitch, mm.
        image: Picture of the stopped-down lens, (H, W, 3).
        defocus: Signed blur radius, pixels, (H, W).
        truth: Traced picture, (H, W, 3).
        inner: Pixels out of reach of depth edges and of the border, (H, W).
        noise: PSNR of the truth's own noise inside ``inner``, and of the whole picture, dB.
    """

    lens: PrescriptionLens
    pixel_pitch: float
    image: np.ndarray
    defocus: np.ndarray
    truth: np.ndarray
    inner: np.ndarray
    noise: tuple[float, float]


def trace_case(name: str, size: tuple[int, int], samples: int) -> LensCase:
    """Trace the scene through a lens of the catalog; ``samples`` of each wavelength, twice."""
    lens = load_lens(name, focus_distance=_FOCUS * load_lens(name).focal_length)
    camera = _camera(lens, *size, lens.prescription.image_radius)
    scene = _make_scene(lens, camera, np.random.default_rng(5))
    sharp = Tracer(world_from_scene(scene), dataclasses.replace(camera, lens=_StoppedDown(lens)))
    image, disparity = sharp.render(64).bokeh.numpy(), sharp.maps().disparity.numpy()
    defocus = (lens.coc_radius(disparity) / camera.pixel_pitch).astype(np.float32)
    first, second = (_trace(scene, lens, camera, samples, seed) for seed in (0, 1000))
    inner = _inner(defocus, 0.012 * camera.width)
    inside, everywhere = (decibels + 20 * math.log10(2) for decibels in score(first, second, inner))
    return LensCase(
        lens=lens,
        pixel_pitch=camera.pixel_pitch,
        image=image,
        defocus=defocus,
        truth=(first + second) / 2,
        inner=inner,
        noise=(inside, everywhere),
    )


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lenses", nargs="+", default=_LENSES)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument(
        "--samples", type=int, default=3, help=f"samples of each of {_WAVELENGTHS} wavelengths, twice"
    )
    parser.add_argument("--sheets", type=Path, help="folder for the pictures of each lens")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print("PSNR, dB, of sRGB pictures; inner: outside the reach of edges in depth and of the border")
    print(f"{'lens':15s}{'picture':26s}{'inner':>8s}{'all':>8s}")
    for name in arguments.lenses:
        case = trace_case(name, tuple(arguments.size), arguments.samples)
        lens, image, truth, defocus, inner = case.lens, case.image, case.truth, case.defocus, case.inner
        aberration_map = fit_aberration_map(lens)
        pictures = {
            "rays, perfect lens": rays(image, defocus),
            "rays, one wavelength": rays(
                image,
                defocus,
                lens_response=LensResponse(aberration_map=fit_aberration_map(lens, wavelengths=())),
            ),
            "rays, lens": rays(image, defocus, lens_response=LensResponse(aberration_map=aberration_map)),
        }
        for label, (inside, everywhere) in {
            **{key: score(picture, truth, inner) for key, picture in pictures.items()},
            "noise of the truth": case.noise,
        }.items():
            print(f"{name:15s}{label:26s}{inside:8.2f}{everywhere:8.2f}", flush=True)
        print(
            f"{name:15s}{inner.mean():.0%} of the picture is inner; "
            f"defocus {defocus.min():.1f} to {defocus.max():.1f} pixels",
            flush=True,
        )
        if arguments.sheets is not None:
            arguments.sheets.mkdir(parents=True, exist_ok=True)
            error = np.abs(encode(pictures["rays, lens"]) - encode(truth)) * 8
            cells = [("stopped down", image), ("traced", truth), ("rays, lens", pictures["rays, lens"])]
            more_cells = [
                ("rays, perfect lens", pictures["rays, perfect lens"]),
                ("8 x error", error),
                ("8 x error, inner", error * inner[..., None]),
            ]
            write_image(arguments.sheets / f"picture_{name}.png", contact_sheet([cells, more_cells]))


if __name__ == "__main__":
    main()
