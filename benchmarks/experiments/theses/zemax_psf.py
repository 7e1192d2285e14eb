"""Point spread functions of Zemax against ours: ``python -m benchmarks.experiments.theses.zemax_psf``.

The files are those of github.com/lykelee/CLDefocus, ``datasyn/psf-demo/zemax`` (MIT): Huygens PSFs of lenses
from patents, on an image surface 0.2 mm behind the focal plane. The prescriptions are not among them: the
reader types them from the patent into a lens file, here European patent application EP 3 029 504 A1, example
4, with the plate of glass at the sensor. Ours are geometric (rays through the glass, a histogram of 2 um) and
with diffraction, from the traced wavefront.
"""

import argparse
import re
from pathlib import Path

import numpy as np

from bokehnet.lenses import PrescriptionLens, load_lens
from bokehnet.lenses.aberrations.point_spread import correlation
from bokehnet.lenses.aberrations.wavefront import trace_wavefront, wave_psf
from bokehnet.lenses.surface_trace import beam_between, trace

__all__ = ["angle_of_height", "parallel_psf", "read_zemax"]

_PITCH_MM, _SHIFT_MM = 0.002, 0.2

# Rays across the entrance pupil, and half of the traced width, pupil radii.
_RAYS, _HALF_WIDTH = 1200, 1.4

# Iterations of the angle: distortion changes slowly.
_ITERATIONS = 4

# Rays along each side of the wavefront.
_WAVE_RAYS = 513


def read_zemax(path: Path) -> tuple[np.ndarray, float]:
    """Return a PSF of sum 1, (N, N), y upwards, and the height of its centroid, mm."""
    with np.load(path, allow_pickle=False) as file:
        psf, header = np.asarray(file["psf"], float), str(file["header"])
    height = re.search(r"Centroid coordinates:\s*\S+,\s*(\S+)", header)
    assert height is not None
    return psf / psf.sum(), float(height[1])


def angle_of_height(lens: PrescriptionLens, shift: float, height: float) -> float:
    """Return the angle of light from infinity, degrees, whose PSF has its centroid at a height, mm."""
    slope = height / lens.focal_length
    for _ in range(_ITERATIONS if height else 0):
        slope *= height / parallel_psf(lens, float(np.degrees(np.arctan(slope))), shift, 8)[1]
    return float(np.degrees(np.arctan(slope)))


def parallel_psf(lens: PrescriptionLens, angle: float, shift: float, size: int) -> tuple[np.ndarray, float]:
    """Return the geometric PSF of light from infinity, (size, size) about its centroid, and the centroid.

    Args:
        lens: Lens focused at infinity.
        angle: Angle of the light to the axis, degrees.
        shift: Distance of the image surface behind the last one of the lens, mm.
        size: Side of the histogram, cells of 2 um; y upwards.
    """
    entrance, slope = lens.paraxial.entrance, np.tan(np.radians(angle))
    steps = np.linspace(-_HALF_WIDTH, _HALF_WIDTH, _RAYS) * abs(float(entrance.radius))
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    start, zero = y + slope * (-1 - float(entrance.position)), np.zeros_like(x)
    before = beam_between((x, start - slope, zero - 2), (x, start, zero - 1))
    beam = trace(lens.surfaces, before)
    last = max(surface.vertex for surface in lens.surfaces)
    px, py = (part[beam.passes] for part in beam.at(zero + last + shift))
    middle = float(py.mean())
    edges = (np.arange(size + 1) - size / 2) * _PITCH_MM
    cells = np.histogram2d(middle - py, px, (edges, edges))[0]
    return cells / cells.sum(), middle


def _centred(psf: np.ndarray) -> np.ndarray:
    """Return a PSF shifted by whole cells to its centroid."""
    middle = np.array(psf.shape) // 2
    at = [np.average(np.arange(size), weights=psf.sum(1 - axis)) for axis, size in enumerate(psf.shape)]
    return np.roll(psf, np.round(middle - np.array(at)).astype(int), (0, 1))


def _radius(psf: np.ndarray) -> float:
    """Return the root mean square radius, um."""
    y, x = np.indices(psf.shape)
    square = sum((axis - (axis * psf).sum()) ** 2 for axis in (y, x))
    return 1000 * _PITCH_MM * float(np.sqrt((square * psf).sum()))


def _diffraction_psf(
    lens: PrescriptionLens, height: float, position: float, size: int, apodisation: float
) -> np.ndarray:
    """Return the PSF with diffraction at an image height, mm, on the surface at ``position``, mm."""
    front = trace_wavefront(lens, abs(height) / lens.prescription.image_radius, count=_WAVE_RAYS)
    offsets = (np.arange(size) - size // 2) * _PITCH_MM
    return wave_psf(front, offsets, position - lens.sensor_position, count=1024, apodisation=apodisation)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the files")
    parser.add_argument("lens", type=Path, help="lens file of the patent's example")
    parser.add_argument("--prefix", default="EP3029504_Example04P")
    parser.add_argument("--back", type=float, default=0.8, help="last surface to image, mm, by the patent")
    parser.add_argument(
        "--apodisation", type=float, default=0.0, help="factor of a Gaussian pupil, see wave_psf"
    )
    arguments = parser.parse_args()
    lens = load_lens(arguments.lens)
    last = max(surface.vertex for surface in lens.surfaces)
    print(
        f"focal length {lens.focal_length:.3f} mm, paraxial image {lens.gaussian_focus - last:.4f} mm behind"
    )
    shift = arguments.back + _SHIFT_MM
    for path in sorted(arguments.folder.glob(f"{arguments.prefix}__f*.npz")):
        psf, height = read_zemax(path)
        zemax, angle = _centred(psf), angle_of_height(lens, shift, height if abs(height) > _PITCH_MM else 0.0)
        rays = _centred(parallel_psf(lens, angle, shift, len(zemax))[0])
        waves = _centred(_diffraction_psf(lens, height, last + shift, len(zemax), arguments.apodisation))
        print(
            f"{height:8.4f} mm, {angle:5.2f} degrees: correlation of rays {correlation(zemax, rays):.3f}, "
            f"with diffraction {correlation(zemax, waves):.3f}, "
            f"RMS radius {_radius(zemax):.2f}, {_radius(rays):.2f} and {_radius(waves):.2f} um",
            flush=True,
        )


if __name__ == "__main__":
    main()
