"""Profile textures: the light of a lens's blur over its radius, one row for each distance of the image.

Every point is taken to blur as one on the axis does: one texture of two dimensions, traced once, stands for
the lens. How deep the point is, and which colour its light has, only chooses the row: both move its Gaussian
image, and what counts is how far behind it the sensor stands. Spherical aberration and axial colour are in
it, what changes over the field is not.

Source: Marsicano, "Rendering real time depth of field effects", 2023, 5.2.1 and 5.2.2, for textures of
profiles; the mappings are ours.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_at_least
from bokehnet.errors import LensError
from bokehnet.lenses.focus_shift import focus_shift
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.surface_trace import beam_between, trace

__all__ = ["ProfileTexture", "profile_psf", "profile_row", "trace_profile_texture"]

# Zones of the entrance pupil, even in area, up to this share of its Gaussian radius: real ones are larger.
_ZONES, _WIDEST = 8_000, 1.5
# Rows reach beyond what is asked for, so that colours and rounding stay within.
_RESERVE = 1.1


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProfileTexture:
    """A texture of profiles.

    Attributes:
        planes: How far each row's sensor stands behind the Gaussian image, mm, rising, (P,); nearer to each
            other near the focus, where profiles change fastest.
        reach: Radius of all of a row's light, mm, (P,).
        light: Light per area at the middles of even shares of that radius, over the mean of the disc,
            (P, N) float32.
        image_gap: From the exit pupil to the Gaussian image of what is in focus, mm.
    """

    planes: np.ndarray
    reach: np.ndarray
    light: np.ndarray
    image_gap: float

    @property
    def size(self) -> int:
        """Bytes of all that it holds."""
        return int(self.planes.nbytes + self.reach.nbytes + self.light.nbytes + 8)


def trace_profile_texture(
    lens: PrescriptionLens, *, farthest: float | None = None, rows: int = 64, columns: int = 64
) -> ProfileTexture:
    """Trace the texture of a lens, as it is focused and stopped down, at its design wavelength.

    Args:
        lens: The lens.
        farthest: How far from its Gaussian image the sensor can stand, mm to both sides; None is where the
            blur radius is a tenth of the picture's half-diagonal.
        rows: Distances of the image.
        columns: Radii.

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
    planes = _RESERVE * farthest * np.linspace(-1, 1, rows) ** 3
    reach, light = np.empty(rows), np.empty((rows, columns), np.float32)
    middles = (np.arange(columns) + 0.5) / columns
    for row, plane in enumerate(planes):
        radius, share = _blur_on_axis(lens, _nearness(lens, float(plane), gap))
        reach[row] = radius.max() * (1 + 1e-9) + 1e-9
        seen, _ = np.histogram(radius / reach[row], columns, (0, 1), weights=share)
        # The area of ring k of N is (2 k + 1) / N^2 of the disc.
        light[row] = seen * columns / (2 * middles)
    return ProfileTexture(planes=planes, reach=reach, light=light, image_gap=gap)


def _nearness(lens: PrescriptionLens, plane: float, gap: float) -> float:
    """One over the depth, 1/mm, whose Gaussian image a row stands behind; below 0 where no real point is.

    The inverse of :func:`profile_row`.
    """
    cardinal, exit_pupil = lens.paraxial.cardinal, float(lens.paraxial.exit.position)
    image = exit_pupil + (lens.sensor_position - exit_pupil) / (1 + plane / gap)
    front = 1 / lens.focal_length - 1 / (image - float(cardinal.rear_principal))
    return front / (1 + front * (lens.front_vertex - float(cardinal.front_principal)))


def _blur_on_axis(lens: PrescriptionLens, nearness: float) -> tuple[np.ndarray, np.ndarray]:
    """Where rays of a point on the axis meet the sensor, mm from it, and the share of its light of each."""
    entrance = lens.paraxial.entrance
    height = _WIDEST * abs(float(entrance.radius)) * np.sqrt((np.arange(_ZONES) + 0.5) / _ZONES)
    slope = -height * nearness
    nothing = np.zeros_like(height)
    first = min(0.0, float(entrance.position)) - 1.0
    start = height + (float(entrance.position) - first) * slope
    beam = trace(lens.surfaces, beam_between((start + slope, nothing, first - 1.0), (start, nothing, first)))
    if not beam.passes.any():
        raise LensError(f"{lens.prescription.name}: no ray passes from a point on the axis")
    # A small patch that faces the lens sends cos^4 into equal areas of the pupil's plane.
    share = (1 / (1 + slope**2) ** 2)[beam.passes]
    return np.abs(beam.at(lens.sensor_position)[0][beam.passes]), share / share.sum()


def profile_row(
    texture: ProfileTexture, lens: PrescriptionLens, depth: float, wavelength: float | None = None
) -> float:
    """Return the plane of the texture, mm, that has the blur of a depth (mm) and a wavelength (nm).

    The point is imaged at v by Gaussian optics, from an exit pupil at e, and blurred over
    ``R (s - v) / (v - e)`` on the sensor at s. The row has that radius: its plane is ``(s - v) / (v - e)``
    times ``v - e`` of what is in focus. Light of another wavelength is moved by how far its sharpest plane,
    over the whole opening, is from that of the design wavelength.
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
    """Return the blur of a point, (size, size, C), all channels together C but for what falls outside.

    Args:
        texture: Of the lens.
        rows: Plane of each wavelength from :func:`profile_row`, mm, (L,).
        colors: What each wavelength carries of the channels, (L, C).
        pitch: Distance between two cells, mm.
        size: Cells along each side.
    """
    axis = (np.arange(size) + 0.5 - size / 2) * pitch
    radius = np.hypot(axis, axis[:, None])
    count, columns = texture.light.shape
    picture = np.zeros((size, size, colors.shape[1]))
    place = np.interp(rows, texture.planes, np.arange(count))
    for at, color in zip(place, colors, strict=True):
        row = min(int(at), count - 2)
        share = at - row
        reach = (1 - share) * texture.reach[row] + share * texture.reach[row + 1]
        profile = (1 - share) * texture.light[row] + share * texture.light[row + 1]
        # All light within a radius, so that a ring thinner than a cell is spread over it.
        within = np.concatenate([[0.0], np.cumsum(profile * (2 * np.arange(columns) + 1) / columns**2)])
        ends = (np.maximum(radius - pitch / 2, 0), radius + pitch / 2)
        low, high = (np.interp(end / reach * columns, np.arange(columns + 1), within) for end in ends)
        seen = (high - low) / (np.pi * (ends[1] ** 2 - ends[0] ** 2))
        picture += seen[..., None] * color
    total = float(colors.sum())
    return picture * (pitch * pitch * colors.shape[1] / total)
