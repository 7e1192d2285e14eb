"""Profile textures: radial blur profiles of a lens, one row per image distance.

The blur of every point is approximated by that of a point on the axis, so one two-dimensional texture, traced
once, represents the lens. Depth and wavelength only select the row: both move the Gaussian
image, and the relevant quantity is the distance of the sensor behind it. The texture includes spherical
aberration and axial colour, but no change over the field.

Source: Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation, 5.2.1
and 5.2.2, for textures of profiles; the mappings are our own.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_at_least
from bokehnet.errors import LensError
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.pupils.focus_shift import focus_shift
from bokehnet.lenses.surface_trace import beam_between, trace

__all__ = ["ProfileTexture", "profile_psf", "profile_row", "trace_profile_texture"]

# Number of zones of equal area of the entrance pupil, and their outer radius over the paraxial radius; real
# pupils can be larger than paraxial ones.
_ZONES, _MAX_RADIUS = 8_000, 1.5
# Range of the rows over the requested range, to include chromatic shifts and rounding.
_RANGE_RESERVE = 1.1


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProfileTexture:
    """Texture of radial blur profiles.

    Attributes:
        planes: Distance of the sensor behind the Gaussian image for each row, mm, ascending, (P,); denser
            near the focus, where profiles change fastest.
        reach: Radius that contains all light of a row, mm, (P,).
        light: Light per area at the centres of equal steps of that radius, over the mean of the disc,
            (P, N) float32.
        image_gap: Distance from the exit pupil to the Gaussian image of the focus, mm.
    """

    planes: np.ndarray
    reach: np.ndarray
    light: np.ndarray
    image_gap: float

    @property
    def size(self) -> int:
        """Size in bytes."""
        return int(self.planes.nbytes + self.reach.nbytes + self.light.nbytes + 8)


def trace_profile_texture(
    lens: PrescriptionLens, *, farthest: float | None = None, rows: int = 64, columns: int = 64
) -> ProfileTexture:
    """Trace the profile texture of a lens, with focus and iris as set, at its design wavelength.

    Args:
        lens: Lens to trace.
        farthest: Largest distance of the sensor from the Gaussian image, mm to both sides; None is the
            distance at which the blur radius is a tenth of the half-diagonal.
        rows: Number of image distances.
        columns: Number of radii.

    Raises:
        LensError: No ray passes from a point on the axis.
        ParameterError: Fewer than two rows or columns.
    """
    check_at_least("rows", rows, 2)
    check_at_least("columns", columns, 2)
    exit_pupil = lens.paraxial.exit
    gap = lens.gaussian_focus - float(exit_pupil.position)
    if farthest is None:
        farthest = 0.1 * lens.prescription.image_radius * abs(gap / float(exit_pupil.radius))
    planes = _RANGE_RESERVE * farthest * np.linspace(-1, 1, rows) ** 3
    reach, light = np.empty(rows), np.empty((rows, columns), np.float32)
    middles = (np.arange(columns) + 0.5) / columns
    for row, plane in enumerate(planes):
        radius, weights = _blur_on_axis(lens, _disparity_of_plane(lens, float(plane), gap))
        reach[row] = radius.max() * (1 + 1e-9) + 1e-9
        counts, _ = np.histogram(radius / reach[row], columns, (0, 1), weights=weights)
        # The area of ring k of N is (2 k + 1) / N^2 of the disc.
        light[row] = counts * columns / (2 * middles)
    return ProfileTexture(planes=planes, reach=reach, light=light, image_gap=gap)


def _disparity_of_plane(lens: PrescriptionLens, plane: float, gap: float) -> float:
    """Return the inverse depth, 1/mm, whose Gaussian image lies a row's distance in front of the sensor.

    The inverse of :func:`profile_row`; below 0 if no real point has this image.
    """
    cardinal, exit_pupil = lens.paraxial.cardinal, float(lens.paraxial.exit.position)
    image = exit_pupil + (lens.sensor_position - exit_pupil) / (1 + plane / gap)
    front = 1 / lens.focal_length - 1 / (image - float(cardinal.rear_principal))
    return front / (1 + front * (lens.front_vertex - float(cardinal.front_principal)))


def _blur_on_axis(lens: PrescriptionLens, disparity: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the radii at which rays of an axial point meet the sensor, mm, and their fractions of light."""
    entrance = lens.paraxial.entrance
    height = _MAX_RADIUS * abs(float(entrance.radius)) * np.sqrt((np.arange(_ZONES) + 0.5) / _ZONES)
    slope = -height * disparity
    zeros = np.zeros_like(height)
    first = min(0.0, float(entrance.position)) - 1.0
    start = height + (float(entrance.position) - first) * slope
    beam = trace(lens.surfaces, beam_between((start + slope, zeros, first - 1.0), (start, zeros, first)))
    if not beam.passes.any():
        raise LensError(f"{lens.prescription.name}: no ray passes from a point on the axis")
    # A small patch that faces the lens sends cos^4 into equal areas of the plane of the pupil.
    weights = (1 / (1 + slope**2) ** 2)[beam.passes]
    return np.abs(beam.at(lens.sensor_position)[0][beam.passes]), weights / weights.sum()


def profile_row(
    texture: ProfileTexture, lens: PrescriptionLens, depth: float, wavelength: float | None = None
) -> float:
    """Return the plane of the texture, mm, with the blur of a depth (mm) and a wavelength (nm).

    The Gaussian image of the point is at v, the exit pupil at e, and the blur radius
    ``R (s - v) / (v - e)`` on the sensor at s. The row has this radius: its plane is ``(s - v) / (v - e)``
    times ``v - e`` of the focus. Light of another wavelength is shifted by the distance of its sharpest
    plane, at full aperture, from that of the design wavelength.
    """
    cardinal = lens.paraxial.cardinal
    # Depths count from the entrance pupil.
    front = depth - lens.front_vertex + float(cardinal.front_principal)
    image = float(cardinal.rear_principal) + 1 / (1 / lens.focal_length - 1 / front)
    row = (lens.sensor_position - image) / (image - float(lens.paraxial.exit.position)) * texture.image_gap
    if wavelength is None:
        return row
    focus = lens.paraxial.entrance, lens.focus_distance, lens.gaussian_focus
    return row - (focus_shift(lens.surfaces_at(wavelength), *focus) - focus_shift(lens.surfaces, *focus))


def profile_psf(
    texture: ProfileTexture, rows: np.ndarray, colors: np.ndarray, pitch: float, size: int
) -> np.ndarray:
    """Return the blur of a point, (size, size, C), with sum C over all channels, less the light outside.

    Args:
        texture: Texture of the lens.
        rows: Plane of each wavelength from :func:`profile_row`, mm, (L,).
        colors: Weight of each wavelength in the channels, (L, C).
        pitch: Distance between two cells, mm.
        size: Number of cells along each side.
    """
    axis = (np.arange(size) + 0.5 - size / 2) * pitch
    radius = np.hypot(axis, axis[:, None])
    count, columns = texture.light.shape
    picture = np.zeros((size, size, colors.shape[1]))
    place = np.interp(rows, texture.planes, np.arange(count))
    for at, color in zip(place, colors, strict=True):
        row = min(int(at), count - 2)
        fraction = at - row
        reach = (1 - fraction) * texture.reach[row] + fraction * texture.reach[row + 1]
        profile = (1 - fraction) * texture.light[row] + fraction * texture.light[row + 1]
        # Cumulative light, so that a ring thinner than a cell is spread over it.
        cumulative = np.concatenate([[0.0], np.cumsum(profile * (2 * np.arange(columns) + 1) / columns**2)])
        ends = (np.maximum(radius - pitch / 2, 0), radius + pitch / 2)
        low, high = (np.interp(end / reach * columns, np.arange(columns + 1), cumulative) for end in ends)
        density = (high - low) / (np.pi * (ends[1] ** 2 - ends[0] ** 2))
        picture += density[..., None] * color
    total = float(colors.sum())
    return picture * (pitch * pitch * colors.shape[1] / total)
