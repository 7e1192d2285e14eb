"""A prescription reduced to third-order theory: a few numbers per wavelength instead of surfaces.

Seven parameters are Gaussian optics: focal length, two principal planes, place and radius of two pupils. They
move and scale the picture and the pupil from wavelength to wavelength. Seidel's five coefficients tell how
rays miss at the sensor, and five more how those through a place in the stop miss its image, the entrance
pupil. Together they make an aberration map that is exact up to the third order in a and h; its unit disc is
the stop. What the rims of other surfaces cut off, and all higher orders, only traced rays know.

Source: Welford, "Aberrations of optical systems", 1986, ch. 8 and 10; the parameters per wavelength after
Asberg, "Parametrically replicating bokeh using Seidel aberration", 2020.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, check_at_least
from bokehnet.errors import ParameterError
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.pupils import ParaxialLens, paraxial_lens
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

# Of the visible spectrum, evenly spread, nm.
WAVELENGTHS = tuple(float(wavelength) for wavelength in np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 64))

_SUMS = ("spherical", "coma", "astigmatism", "petzval", "distortion")
_Ray = tuple[Array, Array]


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class SeidelLens:
    """What is left of a lens; every number is an array with one value per wavelength, (L,).

    Attributes:
        wavelengths: Nanometres.
        focal_length: mm.
        front_principal: Place of the front principal plane, mm behind the first surface.
        rear_principal: The same of the rear principal plane.
        entrance_position: The same of the entrance pupil.
        entrance_radius: Of the entrance pupil, mm; below 0 it is upside down.
        exit_position: As of the entrance pupil.
        exit_radius: As of the entrance pupil.
        image: Where rays miss at the sensor, half-diagonals of the picture.
        pupil: Where rays miss the entrance pupil, in its radii, with the parts of a and h exchanged.
        blur: Transverse aberration E per a by Gaussian optics, half-diagonals: axial colour, 0 at the design
            wavelength.
        shift: The same per h: lateral colour.
        pupil_size: Coordinate A per a by Gaussian optics, 1 at the design wavelength.
        pupil_shift: The same per h, 0 there.
        rise: The light that places in the stop send to the sensor is ``1 + rise a.a + tilt a.h``.
        tilt: As told at ``rise``.
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
            picture: The same lens at one wavelength. A picture taken by its middle rays, distortion and all,
                is what the map is counted in. None counts in the perfect picture, so that distortion stays.
        """
        blur, shift, size, pupil_shift = (
            value[:, None, None] for value in (self.blur, self.shift, self.pupil_size, self.pupil_shift)
        )
        # A ray of third order is the one that Gaussian optics sends from h - E through a + (A - a).
        third, moved = (
            self.image.transverse_aberration(),
            self.pupil.pupil_aberration() - uniform_irradiance(self.rise, self.tilt),
        )
        transverse_aberration, pupil_aberration = (
            (1 - shift) * third + blur * moved,
            size * moved - pupil_shift * third,
        )
        for table, per_pupil, per_field in (
            (transverse_aberration, self.blur, self.shift),
            (pupil_aberration, self.pupil_size - 1, self.pupil_shift),
        ):
            table[:, 0, term(0, 0, 0)] += per_pupil
            table[:, 1, term(0, 0, 0)] += per_field
        if picture is not None:
            # The picture shows x where ``p - s A - E = x`` for a = 0; to this order it is stretched by the
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
    """Reduce a lens, as it is focused and stopped down, to third-order theory.

    Args:
        lens: The lens.
        half_diagonal: From the middle to the corner of the picture, mm on the sensor; None is the radius
            that the lens is made for.
        wavelengths: Nanometres, rising.

    Raises:
        ParameterError: The picture has no size, or there are no wavelengths.
    """
    corner = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    check_at_least("half_diagonal", corner, 0)
    if corner == 0:
        raise ParameterError("half_diagonal", "more than 0 mm", corner)
    colours = np.asarray(wavelengths, float)
    if colours.ndim != 1 or colours.size == 0:
        raise ParameterError("wavelengths", "a list of one or more", wavelengths)
    surfaces = lens.surfaces_at(colours)
    gauss = paraxial_lens(surfaces)
    cardinal, entrance = gauss.cardinal, gauss.entrance
    radius = abs(entrance.radius)
    # Lateral travel per depth, towards the scene, of the marginal and of the chief ray.
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
    # Where they cross the entrance pupil of the design wavelength, from which the picture is seen.
    design = lens.paraxial.entrance
    distance = entrance.position - design.position
    marginal_place, chief_place = radius + distance * marginal_slope, distance * chief_slope
    scale = lens.sensor_distance / corner
    nearness = 1 / lens.focus_distance
    rise, tilt = _light(gauss, SeidelCoefficients.from_sums(rear, -lagrange), lens.sensor_position, corner)

    def each(value: Array) -> np.ndarray:
        return np.broadcast_to(np.asarray(value, float), colours.shape)

    return SeidelLens(
        wavelengths=colours,
        focal_length=each(cardinal.focal_length),
        front_principal=each(cardinal.front_principal),
        rear_principal=each(cardinal.rear_principal),
        entrance_position=each(entrance.position),
        entrance_radius=each(entrance.radius),
        exit_position=each(gauss.exit.position),
        exit_radius=each(gauss.exit.radius),
        image=SeidelCoefficients.from_sums(image, lagrange),
        pupil=SeidelCoefficients.from_sums(front, lagrange),
        blur=each(scale * (marginal_slope + nearness * marginal_place)),
        shift=each(1 + scale * (chief_slope + nearness * chief_place)),
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
    """Return the aberration map of a lens by third-order theory, with the first-order change of colour.

    Args:
        lens: The lens, as it is focused and stopped down.
        half_diagonal: As in :func:`reduce_lens`.
        distortion: Keep the distortion of the picture and of its pupils at the design wavelength; what
            distortion changes with the wavelength is colour and always stays.
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
    """Sums with the two rays exchanged, of the surfaces in front of the stop and behind it; sums of all."""
    front, rear, image = SeidelSums(), SeidelSums(), SeidelSums()
    stop = next(number for number, surface in enumerate(surfaces) if surface.stop)
    for number, own, exchanged in _each_surface(surfaces, marginal, chief):
        image = image + own
        front, rear = (front + exchanged, rear) if number < stop else (front, rear + exchanged)
    return front, rear, image


def _each_surface(
    surfaces: Sequence[Surface], marginal: _Ray, chief: _Ray
) -> Iterator[tuple[int, SeidelSums, SeidelSums]]:
    """Number of each surface but the stop, its sums, and those with the two rays exchanged."""
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
    """Return number (from 1) and Seidel sums S1 to S5, mm, of each surface, at the design wavelength.

    For the lens as it is focused and stopped down, and the corner of its picture.
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
    """``rise`` and ``tilt`` of :class:`SeidelLens`: how areas of the stop grow on their way, times cos^4.

    ``exit_pupil`` tells where rays miss the exit pupil, in its radii.
    """
    distance = sensor - gauss.exit.position
    upright = np.sign(gauss.exit.radius * gauss.entrance.radius)
    pupil, field = upright * abs(gauss.exit.radius) / distance, corner / distance
    rise = 4 * exit_pupil.distortion - 2 * pupil * pupil
    tilt = 6 * exit_pupil.astigmatism + 2 * exit_pupil.field_curvature + 4 * pupil * field
    return rise, tilt
