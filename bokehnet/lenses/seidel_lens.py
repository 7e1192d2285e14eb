"""Reduction of a prescription to third-order theory: a few numbers per wavelength instead of surfaces.

Seven parameters are Gaussian optics: focal length, two principal planes, position and radius of two pupils.
They move and scale the picture and the pupil from wavelength to wavelength. Five Seidel coefficients describe
the transverse aberration at the sensor, and five more that of rays through a point of the stop at its image,
the entrance pupil. Together they form an aberration map that is exact up to the third order in a and h; its
unit disc is the stop. Vignetting by the rims of other surfaces and higher orders require ray tracing.

Source: Welford, "Aberrations of optical systems", 1986, ch. 8 and 10; the parameters per wavelength after
Asberg, "Parametrically replicating bokeh using Seidel aberration", 2020.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, check_at_least
from bokehnet.errors import ParameterError
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.pupils.paraxial_lens import ParaxialLens, paraxial_lens
from bokehnet.lenses.surface_trace import Surface
from bokehnet.optics.aberrations.aberration_map import AberrationMap, term
from bokehnet.optics.aberrations.seidel import (
    SeidelCoefficients,
    SeidelSums,
    surface_sums,
    uniform_irradiance,
)
from bokehnet.optics.paraxial import focused_rays
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH

__all__ = ["WAVELENGTHS", "SeidelLens", "reduce_lens", "seidel_aberration_map", "seidel_by_surface"]

# Wavelengths of the visible spectrum, evenly spaced, nm.
WAVELENGTHS = tuple(float(wavelength) for wavelength in np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 64))

_SUMS = ("spherical", "coma", "astigmatism", "petzval", "distortion")
_Ray = tuple[Array, Array]


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class SeidelLens:
    """Third-order description of a lens; every number is an array with one value per wavelength, (L,).

    Attributes:
        wavelengths: Wavelengths, nm.
        focal_length: Focal length, mm.
        front_principal: Position of the front principal plane, mm behind the first surface.
        rear_principal: Position of the rear principal plane, mm behind the first surface.
        entrance_position: Position of the entrance pupil, mm behind the first surface.
        entrance_radius: Radius of the entrance pupil, mm; below 0 it is inverted.
        exit_position: Position of the exit pupil, mm behind the first surface.
        exit_radius: Radius of the exit pupil, mm; below 0 it is inverted.
        image: Coefficients of the transverse aberration at the sensor, half-diagonals of the picture.
        pupil: Coefficients of the transverse aberration at the entrance pupil, in its radii, with a and h
            exchanged.
        blur: Paraxial transverse aberration E per a, half-diagonals: axial colour, 0 at the design
            wavelength.
        shift: Paraxial transverse aberration E per h: lateral colour, 0 at the design wavelength.
        pupil_size: Paraxial coordinate A per a, 1 at the design wavelength.
        pupil_shift: Paraxial coordinate A per h, 0 at the design wavelength.
        rise: Coefficient of a.a in the light ``1 + rise a.a + tilt a.h`` that points of the stop send to the
            sensor.
        tilt: Coefficient of a.h in that light.
    """

    wavelengths: np.ndarray
    focal_length: np.ndarray
    front_principal: np.ndarray
    rear_principal: np.ndarray
    entrance_position: np.ndarray
    entrance_radius: np.ndarray
    exit_position: np.ndarray
    exit_radius: np.ndarray
    image: SeidelCoefficients
    pupil: SeidelCoefficients
    blur: np.ndarray
    shift: np.ndarray
    pupil_size: np.ndarray
    pupil_shift: np.ndarray
    rise: np.ndarray
    tilt: np.ndarray

    def aberration_map(self, picture: "SeidelLens | None" = None) -> AberrationMap:
        """Return the aberration map.

        Args:
            picture: The same lens at one wavelength. Positions in the map then refer to the picture formed by
                its chief rays, including distortion. None refers to the ideal picture, so that distortion
                remains.
        """
        blur, shift, size, pupil_shift = (
            value[:, None, None] for value in (self.blur, self.shift, self.pupil_size, self.pupil_shift)
        )
        # A third-order ray is the paraxial ray from h - E through a + (A - a).
        third, pupil = (
            self.image.transverse_aberration(),
            self.pupil.pupil_aberration() - uniform_irradiance(self.rise, self.tilt),
        )
        transverse_aberration, pupil_aberration = (
            (1 - shift) * third + blur * pupil,
            size * pupil - pupil_shift * third,
        )
        for table, per_pupil, per_field in (
            (transverse_aberration, self.blur, self.shift),
            (pupil_aberration, self.pupil_size - 1, self.pupil_shift),
        ):
            table[:, 0, term(0, 0, 0)] += per_pupil
            table[:, 1, term(0, 0, 0)] += per_field
        if picture is not None:
            # The picture shows x at ``p - s A - E = x`` for a = 0; to this order it is stretched by the
            # derivatives of its distortion, and A and E with it.
            shown, entry = float(picture.image.distortion[0]), float(picture.pupil.spherical[0])
            for table, per_pupil, per_field, middle in (
                (transverse_aberration, self.blur, self.shift, shown),
                (pupil_aberration, self.pupil_size, self.pupil_shift, entry),
            ):
                table[:, 0, term(0, 0, 1)] += shown * per_pupil
                table[:, 1, term(0, 1, 0)] += 2 * shown * per_pupil
                table[:, 1, term(0, 0, 1)] += 3 * shown * per_field - middle
        return AberrationMap(
            wavelengths=self.wavelengths,
            transverse_aberration=transverse_aberration,
            pupil_aberration=pupil_aberration,
        )


def reduce_lens(
    lens: PrescriptionLens,
    *,
    half_diagonal: float | None = None,
    wavelengths: Sequence[float] = WAVELENGTHS,
) -> SeidelLens:
    """Reduce a lens, with focus and iris as set, to third-order theory.

    Args:
        lens: Lens to reduce.
        half_diagonal: Distance from the centre to the corner of the picture, mm on the sensor; None is the
            image radius of the lens.
        wavelengths: Wavelengths, nm, ascending.

    Raises:
        ParameterError: The picture has no size, or there are no wavelengths.
    """
    corner = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    check_at_least("half_diagonal", corner, 0)
    if corner == 0:
        raise ParameterError("half_diagonal", "more than 0 mm", corner)
    nanometres = np.asarray(wavelengths, float)
    if nanometres.ndim != 1 or nanometres.size == 0:
        raise ParameterError("wavelengths", "a list of one or more", wavelengths)
    surfaces = lens.surfaces_at(nanometres)
    gauss = paraxial_lens(surfaces)
    cardinal, entrance = gauss.cardinal, gauss.entrance
    radius = abs(entrance.radius)
    # Lateral displacement per depth, towards the scene, of the marginal and of the chief ray.
    marginal_slope, chief_slope = (
        focused_rays(
            place,
            origin,
            cardinal.focal_length,
            entrance.position - cardinal.front_principal,
            lens.sensor_position - cardinal.rear_principal,
        )
        for place, origin in ((0.0, radius), (corner, 0.0))
    )
    # Height and slope at the first surface, towards the sensor.
    marginal = radius + entrance.position * marginal_slope, -marginal_slope
    chief = entrance.position * chief_slope, -chief_slope
    lagrange = chief[1] * marginal[0] - marginal[1] * chief[0]
    front, rear, image = _sums(surfaces, marginal, chief)
    # Intersections with the entrance pupil of the design wavelength, the centre of perspective.
    design = lens.paraxial.entrance
    distance = entrance.position - design.position
    marginal_place, chief_place = radius + distance * marginal_slope, distance * chief_slope
    scale = lens.sensor_distance / corner
    focus_disparity = 1 / lens.focus_distance
    rise, tilt = _light(gauss, SeidelCoefficients.from_sums(rear, -lagrange), lens.sensor_position, corner)

    def each(value: Array) -> np.ndarray:
        return np.broadcast_to(np.asarray(value, float), nanometres.shape)

    return SeidelLens(
        wavelengths=nanometres,
        focal_length=each(cardinal.focal_length),
        front_principal=each(cardinal.front_principal),
        rear_principal=each(cardinal.rear_principal),
        entrance_position=each(entrance.position),
        entrance_radius=each(entrance.radius),
        exit_position=each(gauss.exit.position),
        exit_radius=each(gauss.exit.radius),
        image=SeidelCoefficients.from_sums(image, lagrange),
        pupil=SeidelCoefficients.from_sums(front, lagrange),
        blur=each(scale * (marginal_slope + focus_disparity * marginal_place)),
        shift=each(1 + scale * (chief_slope + focus_disparity * chief_place)),
        pupil_size=each(marginal_place / abs(design.radius)),
        pupil_shift=each(chief_place / abs(design.radius)),
        rise=each(rise),
        tilt=each(tilt),
    )


def seidel_aberration_map(
    lens: PrescriptionLens,
    *,
    half_diagonal: float | None = None,
    distortion: bool = False,
    wavelengths: Sequence[float] = WAVELENGTHS,
) -> AberrationMap:
    """Return the aberration map of a lens by third-order theory, with first-order chromatic aberration.

    Args:
        lens: Lens, with focus and iris as set.
        half_diagonal: As in :func:`reduce_lens`.
        distortion: Keep the distortion of the picture and of its pupils at the design wavelength; changes of
            distortion with the wavelength are lateral colour and always remain.
        wavelengths: As in :func:`reduce_lens`.

    Raises:
        ParameterError: As :func:`reduce_lens`.
    """
    reduced = reduce_lens(lens, half_diagonal=half_diagonal, wavelengths=wavelengths)
    if distortion:
        return reduced.aberration_map()
    design = [lens.prescription.design_wavelength]
    return reduced.aberration_map(reduce_lens(lens, half_diagonal=half_diagonal, wavelengths=design))


def _sums(
    surfaces: Sequence[Surface], marginal: _Ray, chief: _Ray
) -> tuple[SeidelSums, SeidelSums, SeidelSums]:
    """Return the sums with exchanged rays in front of and behind the stop, and the sums of all surfaces."""
    front, rear, image = SeidelSums(), SeidelSums(), SeidelSums()
    stop = next(number for number, surface in enumerate(surfaces) if surface.stop)
    for number, own, exchanged in _each_surface(surfaces, marginal, chief):
        image = image + own
        front, rear = (front + exchanged, rear) if number < stop else (front, rear + exchanged)
    return front, rear, image


def _each_surface(
    surfaces: Sequence[Surface], marginal: _Ray, chief: _Ray
) -> Iterator[tuple[int, SeidelSums, SeidelSums]]:
    """Yield the index of each surface except the stop, its sums, and its sums with the two rays exchanged."""
    place = surfaces[0].vertex
    for number, surface in enumerate(surfaces):
        gap = (surface.vertex - place) / surface.before
        place = surface.vertex
        marginal, chief = ((y + gap * nu, nu) for y, nu in (marginal, chief))
        if surface.stop:
            continue
        glass = surface.vertex_curvature, surface.fourth_order, surface.before, surface.index_after
        yield number, surface_sums(marginal, chief, *glass), surface_sums(chief, marginal, *glass)
        marginal, chief = ((y, nu - surface.power * y) for y, nu in (marginal, chief))


def seidel_by_surface(lens: PrescriptionLens) -> list[tuple[int, dict[str, float]]]:
    """Return the number (from 1) and Seidel sums S1 to S5, mm, of each surface, at the design wavelength.

    The sums are those of the lens with focus and iris as set, at the corner of its picture.
    """
    corner = lens.prescription.image_radius
    cardinal, entrance = lens.paraxial.cardinal, lens.paraxial.entrance
    radius = abs(float(entrance.radius))
    marginal, chief = (
        (place + entrance.position * slope, -slope)
        for place, slope in (
            (
                place,
                focused_rays(
                    at,
                    place,
                    cardinal.focal_length,
                    entrance.position - cardinal.front_principal,
                    lens.sensor_position - cardinal.rear_principal,
                ),
            )
            for at, place in ((0.0, radius), (corner, 0.0))
        )
    )
    return [
        (number + 1, {name: float(getattr(own, name)) for name in _SUMS})
        for number, own, _ in _each_surface(lens.surfaces, marginal, chief)
    ]


def _light(
    gauss: ParaxialLens, exit_pupil: SeidelCoefficients, sensor: float, corner: float
) -> tuple[Array, Array]:
    """Return ``rise`` and ``tilt`` of :class:`SeidelLens`: the change of areas of the stop, times cos^4.

    Args:
        gauss: Gaussian optics of the lens.
        exit_pupil: Coefficients of the transverse aberration at the exit pupil, in its radii.
        sensor: Position of the sensor, mm.
        corner: Half-diagonal of the picture, mm.
    """
    distance = sensor - gauss.exit.position
    upright = np.sign(gauss.exit.radius * gauss.entrance.radius)
    pupil, field = upright * abs(gauss.exit.radius) / distance, corner / distance
    rise = 4 * exit_pupil.distortion - 2 * pupil * pupil
    tilt = 6 * exit_pupil.astigmatism + 2 * exit_pupil.field_curvature + 4 * pupil * field
    return rise, tilt
