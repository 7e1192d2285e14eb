"""Plot of a lens: section with rays, spot diagrams, and blur over distance."""

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from bokehnet.checks import require_extra
from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.reports.depth_of_field import depth_of_field
from bokehnet.lenses.surface_trace import Surface, trace
from bokehnet.optics.sampling import ring_points
from bokehnet.optics.spectral.glass import C_LINE, D_LINE, F_LINE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_blur", "draw_section", "plot_lens", "sharp_radius", "spot"]

_FIELDS = (0.0, 0.7, 1.0)
_FIELD_COLORS = ("#2f6db3", "#c8732b", "#3c8f4f")
_LINES = ((F_LINE, "#2b62c9"), (D_LINE, "#d9a400"), (C_LINE, "#c23b3b"))
_GLASS, _INK = "#cfe3f2", "#33414d"


def sharp_radius(lens: PrescriptionLens) -> float:
    """Return the blur radius that counts as sharp, mm: 1/1500 of the image radius."""
    return lens.prescription.image_radius / 1500


def spot(lens: PrescriptionLens, sensor_radius: float, wavelength: float, rings: int = 16) -> np.ndarray:
    """Return the intersections of the rays of one point in the focal plane with the sensor.

    Args:
        lens: Lens to trace.
        sensor_radius: Distance of the ideal image from the axis, mm, along x.
        wavelength: Wavelength, nm.
        rings: Number of rings of rays in the pupil.

    Returns:
        (rays, 2), mm from the ideal image.
    """
    # Real pupils are larger than paraxial ones; the excess rays are clipped.
    origin = 1.5 * lens.thick.pupil_radius * ring_points(rings)
    ideal = np.array([-sensor_radius, 0.0])
    slope = -ideal / lens.sensor_distance - origin / lens.focus_distance
    xy, passes = lens.trace_to_sensor(Rays(origin=origin, slope=slope), wavelength)
    return np.asarray((xy - ideal)[passes])


def plot_lens(lens: PrescriptionLens) -> "Figure":
    """Return a figure of section and rays, spots, and blur over distance, 12 x 9 inches.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    require_extra("matplotlib", "plot")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 9), layout="constrained")
    FigureCanvasAgg(figure)
    section, below = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    left, right = below.subfigures(1, 2, width_ratios=(1.5, 1))
    design = lens.prescription
    section.suptitle(
        f"{design.name}: f = {lens.focal_length:.4g} mm, f/{lens.thick.f_number:.3g}, "
        f"focused at {_distance(lens.focus_distance)}",
        fontweight="bold",
    )
    draw_section(section.subplots(), lens)
    section.legend(loc="outside lower center", fontsize=8, ncols=4)
    left.suptitle("spots in the focal plane, mm; F blue, d yellow, C red", fontsize=10)
    columns = left.subplots(1, len(_FIELDS), sharex=True, sharey=True)
    half_width = max(_draw_spot(column, lens, field) for column, field in zip(columns, _FIELDS, strict=True))
    columns[0].set(xlim=(-half_width, half_width), ylim=(-half_width, half_width))
    draw_blur(right.subplots(), lens)
    return figure


def _distance(depth: float) -> str:
    return "infinity" if math.isinf(depth) else f"{depth / 1000:.4g} m"


def draw_section(axes: "Axes", lens: PrescriptionLens) -> None:
    """Draw glass, iris, sensor, pupils and principal planes, with the rays of three fields."""
    surfaces, paraxial = lens.surfaces, lens.paraxial
    max_semi_diameter = max(surface.semi_diameter for surface in surfaces)
    for front, back in pairwise(surfaces):
        if front.behind > 1:
            _draw_element(axes, front, back)
    for surface in surfaces:
        if surface.stop:
            for side in (-1, 1):
                edge = max(1.25 * surface.semi_diameter, 0.8 * max_semi_diameter)
                ends = [side * surface.semi_diameter, side * edge]
                axes.plot([surface.vertex] * 2, ends, color="black", lw=2.5)
    first = -0.35 * max(paraxial.length, max_semi_diameter)
    for field, color in zip(_FIELDS, _FIELD_COLORS, strict=True):
        _draw_rays(axes, lens, field * lens.prescription.image_radius, first, color)
    image = 1.05 * lens.prescription.image_radius
    axes.plot([lens.sensor_position] * 2, [-image, image], color="black", lw=2)
    marks: list[tuple[float, float, str, str]] = [
        (paraxial.entrance.position, abs(paraxial.entrance.radius), "entrance pupil", "#8a3ffc"),
        (paraxial.exit.position, abs(paraxial.exit.radius), "exit pupil", "#d12771"),
        (paraxial.cardinal.front_principal, 1.15 * max_semi_diameter, "front principal plane", "#198038"),
        (paraxial.cardinal.rear_principal, 1.15 * max_semi_diameter, "rear principal plane", "#007d79"),
    ]
    room = lens.sensor_position - first
    for place, height, label, color in marks:
        if not first - room < place < lens.sensor_position + room:  # too far away to show with the glass
            axes.plot([], [], color=color, ls="--", lw=1.4, label=f"{label}, at {place:.4g} mm")
            continue
        axes.plot([place] * 2, [-height, height], color=color, ls="--", lw=1.4, label=label)
    axes.axhline(0, color=_INK, lw=0.5, ls=(0, (12, 4, 2, 4)))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("mm from the first surface; the scene is on the left, the sensor on the right")


def _draw_element(axes: "Axes", front: Surface, back: Surface) -> None:
    sides = []
    for surface in (front, back):
        place = np.linspace(-surface.semi_diameter, surface.semi_diameter, 61)
        sides.append((surface.vertex + surface.sag(place * place)[0], place))
    outline = [np.concatenate([sides[0][i], sides[1][i][::-1]]) for i in range(2)]
    axes.fill(*outline, facecolor=_GLASS, edgecolor=_INK, lw=1, zorder=1)


def _draw_rays(axes: "Axes", lens: PrescriptionLens, image: float, first: float, color: str) -> None:
    """Draw seven rays in the plane of the drawing from one sensor point; clipped rays are omitted."""
    count = 7
    sensor_xy = np.tile([-image, 0.0], (count, 1))
    pupil_uv = np.stack([np.linspace(-0.97, 0.97, count), np.zeros(count)], -1)
    beam, _ = lens.aim(sensor_xy, pupil_uv, None)
    points: list[Any] = [(beam.position[2], beam.position[0])]
    for surface in reversed(lens.surfaces):
        beam = trace([surface], beam, backwards=True)
        points.append((beam.position[2], beam.position[0]))
    points.append((np.full(count, first), beam.at(first)[0]))
    t, x = np.array(points).transpose(1, 0, 2)
    axes.plot(t[:, beam.passes], x[:, beam.passes], color=color, lw=0.8, zorder=2)


def _draw_spot(axes: "Axes", lens: PrescriptionLens, field: float) -> float:
    """Draw one spot around its centroid; return its half-width, mm."""
    image = field * lens.prescription.image_radius
    centre = spot(lens, image, lens.prescription.design_wavelength)
    shift = centre.mean(axis=0) if len(centre) else np.zeros(2)
    half_width = sharp_radius(lens)
    for wavelength, color in _LINES:
        points = spot(lens, image, wavelength) - shift
        half_width = max(half_width, float(np.abs(points).max(initial=0)))
        axes.scatter(points[:, 1], points[:, 0], s=3, color=color, lw=0, alpha=0.6)
    angle = np.linspace(0, 2 * np.pi, 73)
    limit = sharp_radius(lens)
    axes.plot(limit * np.cos(angle), limit * np.sin(angle), color=_INK, lw=0.8, ls=":")
    size = float(np.sqrt(((centre - shift) ** 2).sum(1).mean())) if len(centre) else math.nan
    axes.set_title(f"{image:.3g} mm off axis\nrms radius {1000 * size:.3g} µm", fontsize=9)
    axes.set_box_aspect(1)
    axes.tick_params(labelsize=7)
    axes.grid(lw=0.3)
    return 1.05 * half_width


def draw_blur(axes: "Axes", lens: PrescriptionLens) -> None:
    """Draw the circle of confusion over depth, and the depth of field."""
    limit = sharp_radius(lens)
    near, far = depth_of_field(lens, limit)
    centre = lens.focus_distance if math.isfinite(lens.focus_distance) else near
    nearest = max(1.02 * lens.front_vertex, min(near / 3, centre / 4), 1.0)
    farthest = 6 * (far if math.isfinite(far) else max(centre, near))
    depth = np.geomspace(nearest, farthest, 400)
    radius = np.abs(lens.coc_radius(1 / depth))
    axes.plot(depth / 1000, radius, color=_FIELD_COLORS[0])
    axes.axhline(limit, color=_INK, lw=0.8, ls=":", label=f"limit {limit:.3g} mm")
    axes.axvspan(near / 1000, min(far, farthest) / 1000, color="#dcefd8", zorder=0)
    axes.axvline(near / 1000, color="#3c8f4f", lw=1, label=f"near {_distance(near)}")
    if math.isfinite(far):
        axes.axvline(far / 1000, color="#198038", lw=1, ls="--", label=f"far {_distance(far)}")
    else:
        axes.plot([], [], color="#198038", lw=1, ls="--", label="far infinity")
    axes.set_xscale("log")
    ticks = [mantissa * 10.0**power for power in range(-3, 7) for mantissa in (1, 2, 5)]
    axes.set_xticks([tick for tick in ticks if 1000 * tick > nearest and 1000 * tick < farthest])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set_ylim(0, min(float(radius.max()), 12 * limit) * 1.05)
    axes.set_xlabel("depth from the entrance pupil, m")
    axes.set_ylabel("blur radius, mm")
    axes.set_title("circle of confusion and depth of field", fontsize=10)
    axes.legend(fontsize=8)
    axes.grid(lw=0.3)
