"""Report sheet of a lens: all curves in one figure, or an HTML page with tables."""

import base64
import html
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bokehnet.checks import require_extra
from bokehnet.lenses.aberrations.point_spread import PsfGrid, traced_psf
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination
from bokehnet.lenses.aberrations.wavefront import Wavefront, trace_wavefront, wave_mtf, zernike_fit
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.reports.analysis import (
    airy_mtf,
    chromatic_focus,
    field_curvature,
    field_rays,
    geometric_mtf,
    ray_fan,
    spherical_focus,
)
from bokehnet.lenses.reports.depth_of_field import depth_of_field
from bokehnet.lenses.reports.facts import FIELDS, distortion, lens_facts
from bokehnet.lenses.reports.plot import draw_blur, draw_section, sharp_radius
from bokehnet.lenses.seidel_lens import seidel_by_surface
from bokehnet.optics.aberrations.zernike import NAMES as ZERNIKE_NAMES
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.spectral.glass import C_LINE, D_LINE, F_LINE
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["lens_curves", "report_figure", "report_page"]

_COLORS = ("#2f6db3", "#c8732b", "#3c8f4f")
_LINES = ((F_LINE, "#2b62c9"), (D_LINE, "#d9a400"), (C_LINE, "#c23b3b"))
_NAMES = ("middle", "0.7 of the field", "corner")
# Planes of the through-focus spots, in depths of focus of a circle of 1/1500 of the diagonal.
_PLANES = (-4, -2, 0, 2, 4)
# Blur radius of the bokeh sheet, and minimum blur radius behind focus, percent of the half-diagonal.
_MAX_BLUR, _MIN_BLUR = 4.0, 0.5
# Number of cells along each side of a bokeh image, of wavelengths, and of rays per wavelength.
_CELLS, _WAVELENGTHS, _RAYS = 81, 12, 8000


def lens_curves(lens: PrescriptionLens) -> dict[str, Any]:
    """Return the data and curves of a lens as JSON values; NaN is None."""
    fields, zones = np.linspace(0, 1, 21), np.linspace(0.05, 1.1, 22)
    waves, frequencies = np.linspace(420, 680, 14), np.linspace(0, 100, 21)
    tangential, sagittal = field_curvature(lens, fields)
    fronts = [trace_wavefront(lens, field) for field in FIELDS]
    limit = sharp_radius(lens)
    curves: dict[str, Any] = {
        "field_shares": fields,
        "distortion": distortion(lens, fields),
        "tangential_focus": tangential,
        "sagittal_focus": sagittal,
        "relative_illumination": relative_illumination(lens, lens.prescription.image_radius, len(fields)),
        "zones": zones,
        "spherical_focus": spherical_focus(lens, zones),
        "wavelengths": waves,
        "chromatic_focus": chromatic_focus(lens, waves),
        "line_pairs_per_mm": frequencies,
        "diffraction_mtf": airy_mtf(lens, frequencies, lens.prescription.design_wavelength),
        "mtf": [_pair(geometric_mtf(lens, field, frequencies)) for field in FIELDS],
        "wave_mtf": [_pair(wave_mtf(front, frequencies)) for front in fronts],
        "wavefronts": [
            {"rms": front.rms, "zernike": zernike_fit(front), "wavelength": front.wavelength}
            for front in fronts
        ],
        "spots": [_through_focus(lens, field) for field in FIELDS],
        "breathing": dict(zip(("focus_distance", "larger"), _breathing(lens), strict=True)),
        "depth_of_field": {"blur_radius": limit, "range": depth_of_field(lens, limit)},
        "ray_fans": [dict(zip(("pupil", "along", "across"), ray_fan(lens, f), strict=True)) for f in FIELDS],
    }
    result: dict[str, Any] = _json_value(lens_facts(lens) | {"curves": curves})
    return result


def _through_focus(lens: PrescriptionLens, field: float) -> dict[str, Any]:
    """Return root mean square radii of spots in planes behind the sensor, mm, over the lines F, d and C."""
    planes = np.arange(-4, 5) * _plane_step(lens)
    pupil = 1.5 * disc_from_square(np.stack([halton(900, 2), halton(900, 3)], -1))
    bundles = [field_rays(lens, field, pupil, wavelength) for wavelength, _ in _LINES]
    radii = []
    for plane in planes:
        all_points = np.concatenate([(rays.place + plane * rays.slope)[rays.passes] for rays in bundles])
        radii.append(np.sqrt(((all_points - all_points.mean(0)) ** 2).sum(1).mean()))
    return {"planes": planes, "rms_radius": radii}


def _plane_step(lens: PrescriptionLens) -> float:
    """Return the distance of through-focus planes per unit of ``_PLANES``, mm."""
    return lens.prescription.image_radius / 1500 * 2 * lens.working_f_number


def report_page(lenses: Sequence[PrescriptionLens]) -> str:
    """Return one self-contained HTML page with the sheets and tables of lenses, side by side.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    title = html.escape(", ".join(lens.prescription.name for lens in lenses))
    parts = "".join(f"<section>{_section(lens)}</section>" for lens in lenses)
    return (
        f"<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'><title>{title}</title><style>"
        "body{font:15px/1.5 sans-serif;margin:2rem auto;padding:0 1rem;display:flex;gap:2rem}"
        "section{flex:1;min-width:0;max-width:90rem;margin:auto;overflow-x:auto}"
        "table{border-collapse:collapse;margin:1rem 0}td,th{padding:.2rem .8rem;text-align:left;"
        "border-bottom:1px solid #ddd;font-weight:normal}th{color:#555}img{max-width:100%}</style></head>"
        f"<body>{parts}</body></html>\n"
    )


def _section(lens: PrescriptionLens) -> str:
    """Return the sheet and the tables of one lens, as HTML."""
    picture = io.BytesIO()
    report_figure([lens]).savefig(picture, dpi=110, format="png")
    facts = lens_facts(lens)
    name, png_base64 = html.escape(str(facts["name"])), base64.b64encode(picture.getvalue()).decode()
    scalar_rows = "".join(
        f"<tr><th>{html.escape(key.replace('_', ' '))}</th><td>{html.escape(_format_value(value))}</td></tr>"
        for key, value in facts.items()
        if not isinstance(value, list)
    )
    coefficients = [zernike_fit(trace_wavefront(lens, field)) for field in FIELDS]
    waves = [
        {"polynomial": f"Z{number + 1}" + (f", {name}" if name else "")}
        | {field: float(row[number]) for field, row in zip(_NAMES, coefficients, strict=True)}
        for number, name in enumerate([*ZERNIKE_NAMES, *[""] * (len(coefficients[0]) - len(ZERNIKE_NAMES))])
    ]
    return (
        f"<h1>{name}</h1><img src='data:image/png;base64,{png_base64}' alt='sheet'>"
        f"<table>{scalar_rows}</table><h2>Field</h2>{_table(facts['fields'])}"
        f"<h2>Seidel sums by surface, mm</h2>{_table(facts['seidel'])}"
        f"<h2>Wavefront by Noll's polynomials, wavelengths</h2>{_table(waves)}"
    )


def _table(rows: list[dict[str, Any]]) -> str:
    head = "".join(f"<th>{html.escape(key.replace('_', ' '))}</th>" for key in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(_format_value(value))}</td>" for value in row.values()) + "</tr>"
        for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _format_value(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_format_value(inner)}" for key, inner in value.items())
    if value is None:
        return "infinity"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _pair(curves: tuple[np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    return {"tangential": curves[0], "sagittal": curves[1]}


def _json_value(value: Any) -> Any:
    """Return arrays as lists, and numbers that are not finite as None."""
    if isinstance(value, dict):
        return {key: _json_value(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_json_value(inner) for inner in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def report_figure(lenses: Sequence[PrescriptionLens]) -> "Figure":
    """Return a figure with the sheets of lenses, side by side.

    Raises:
        MissingExtraError: matplotlib is not installed.
        LensError: No rays pass a lens.
    """
    require_extra("matplotlib", "plot")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16 * len(lenses), 22), layout="constrained")
    FigureCanvasAgg(figure)
    parts = figure.subfigures(1, len(lenses), squeeze=False)[0]
    for part, lens in zip(parts, lenses, strict=True):
        _draw_sheet(part, lens)
    return figure


def _draw_sheet(part: Any, lens: PrescriptionLens) -> None:
    top, curves, waves, points = part.subfigures(4, 1, height_ratios=(1.0, 1.35, 0.55, 1.25))
    at = "infinity" if math.isinf(lens.focus_distance) else f"{lens.focus_distance / 1000:.4g} m"
    top.suptitle(
        f"{lens.prescription.name}: f = {lens.focal_length:.4g} mm, f/{lens.thick.f_number:.3g} paraxial, "
        f"f/{lens.working_f_number:.3g} working, focused at {at}",
        fontweight="bold",
    )
    draw_section(top.subplots(), lens)
    top.legend(loc="outside lower center", fontsize=8, ncols=4)
    _draw_curves(curves.subplots(3, 4), lens)
    _draw_waves(waves.subplots(1, 6), lens)
    left, right = points.subfigures(1, 2)
    _draw_spots(left, lens)
    _draw_bokeh(right, lens)


def _draw_waves(grid: Any, lens: PrescriptionLens) -> None:
    """Draw wavefronts of three fields, their polynomials, diffraction MTF and depth of field."""
    fronts = [trace_wavefront(lens, field) for field in FIELDS]
    for axes, front, name in zip(grid, fronts, _NAMES, strict=False):
        _draw_front(axes, front, name)
    frequencies = np.linspace(0, 60, 31)
    for number, (front, name, color) in enumerate(zip(fronts, _NAMES, _COLORS, strict=True)):
        values = zernike_fit(front)[3:]
        place = np.arange(len(values)) + 4 + 0.27 * (number - 1)
        grid[3].bar(place, values, 0.26, color=color, label=name)
        tangential, sagittal = wave_mtf(front, frequencies)
        grid[4].plot(frequencies, tangential, color=color)
        grid[4].plot(frequencies, sagittal, color=color, ls="--")
    grid[3].legend(fontsize=6)
    _label(grid[3], "Noll's polynomials from the 4th, waves", "")
    grid[4].set_ylim(0, 1.02)
    _label(grid[4], "MTF by waves, one colour", "line pairs per mm")
    draw_blur(grid[5], lens)
    grid[5].legend(fontsize=6)
    _label(grid[5], "blur radius over depth, mm", "m")


def _draw_front(axes: "Axes", front: Wavefront, name: str) -> None:
    """Draw the wavefront as seen from behind, without mean and tilt, with the field direction upwards."""
    points = front.pupil[front.passes]
    basis = np.concatenate([np.ones((len(points), 1)), points], -1)
    flat = np.full(front.waves.shape, np.nan)
    waves = front.waves[front.passes]
    flat[front.passes] = waves - basis @ np.linalg.lstsq(basis, waves, rcond=None)[0]
    limit = max(float(np.abs(waves - basis @ np.linalg.lstsq(basis, waves, rcond=None)[0]).max()), 1e-6)
    reach = float(front.pupil.max())
    axes.imshow(
        flat, origin="lower", cmap="RdBu_r", vmin=-limit, vmax=limit, extent=(-reach, reach, -reach, reach)
    )
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(f"waves, {name}\nrms {front.rms:.3g}, largest {limit:.3g}", fontsize=9)


def _draw_curves(grid: Any, lens: PrescriptionLens) -> None:
    for column, (field, name) in enumerate(zip(FIELDS, _NAMES, strict=True)):
        _draw_fan(grid[0][column], lens, field, name)
    _draw_mtf(grid[0][3], lens)
    fields = np.linspace(0, 1, 33)
    axes: Axes = grid[1][0]
    axes.plot(fields, 100 * distortion(lens, fields), color=_COLORS[0])
    _label(axes, "distortion, %", "field")
    axes = grid[1][1]
    for curve, style, name in zip(
        field_curvature(lens, fields), ("-", "--"), ("along", "across"), strict=True
    ):
        axes.plot(fields, curve, style, color=_COLORS[1], label=name)
    axes.legend(fontsize=7)
    _label(axes, "focus along and across the field, mm", "field")
    axes = grid[1][2]
    axes.plot(fields, 100 * relative_illumination(lens, lens.prescription.image_radius), color=_COLORS[2])
    axes.set_ylim(0, 105)
    _label(axes, "relative illumination, %", "field")
    axes = grid[1][3]
    zones = np.linspace(0.05, 1.15, 45)
    for wavelength, color in _LINES:
        axes.plot(spherical_focus(lens, zones, wavelength), zones, color=color)
    axes.axvline(lens.focus_shift, color="black", lw=0.8, ls=":")
    _label(axes, "focus of zones, mm; dots: the sensor", "")
    axes = grid[2][0]
    waves = np.linspace(420, 680, 27)
    axes.plot(waves, chromatic_focus(lens, waves), color=_COLORS[0])
    _label(axes, "focus of colours, mm", "nm")
    _draw_seidel(grid[2][1], lens)
    _draw_breathing(grid[2][2], lens)
    _draw_facts(grid[2][3], lens)


def _label(axes: "Axes", title: str, below: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(below, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(lw=0.3)


def _draw_fan(axes: "Axes", lens: PrescriptionLens, field: float, name: str) -> None:
    for wavelength, color in _LINES:
        pupil, along, across = ray_fan(lens, field, wavelength)
        axes.plot(pupil, 1000 * along, color=color, lw=1.2)
        axes.plot(pupil, 1000 * across, color=color, lw=1, ls="--")
    axes.axhline(0, color="black", lw=0.5)
    _label(axes, f"ray fans, µm, {name}; dashes: across", "pupil")


def _draw_mtf(axes: "Axes", lens: PrescriptionLens) -> None:
    frequencies = np.linspace(0, 60, 61)
    for field, name, color in zip(FIELDS, _NAMES, _COLORS, strict=True):
        tangential, sagittal = geometric_mtf(lens, field, frequencies)
        axes.plot(frequencies, tangential, color=color, label=name)
        axes.plot(frequencies, sagittal, color=color, ls="--")
    axes.plot(
        frequencies, airy_mtf(lens, frequencies), color="black", lw=0.8, ls=":", label="diffraction alone"
    )
    axes.set_ylim(0, 1.02)
    axes.legend(fontsize=7)
    _label(axes, "MTF by rays; dashes: lines along the field", "line pairs per mm")


def _draw_seidel(axes: "Axes", lens: PrescriptionLens) -> None:
    rows = seidel_by_surface(lens)
    names = list(rows[0][1])
    place = np.arange(len(rows) + 1)
    for number, name in enumerate(names):
        values = [row[name] for _, row in rows]
        axes.bar(place + 0.16 * (number - 2), [*values, sum(values)], 0.15, label=name)
    axes.set_xticks(place, [*(str(number) for number, _ in rows), "sum"], fontsize=7)
    axes.legend(fontsize=6)
    _label(axes, "Seidel sums by surface, mm", "")


def _breathing(lens: PrescriptionLens) -> tuple[np.ndarray, np.ndarray]:
    """Return focus distances, mm, and the relative enlargement of the picture over focus at infinity."""
    nearest = 8.0 * lens.focal_length
    distance = np.geomspace(nearest, 200 * lens.focal_length, 40)
    cardinal, entrance = lens.paraxial.cardinal, lens.paraxial.entrance
    depth = distance - (entrance.position - cardinal.front_principal)
    image = 1 / (1 / lens.focal_length - 1 / depth)
    principal = entrance.position - cardinal.front_principal
    distance_to_image = image + principal * (image / lens.focal_length - 1)
    return distance, distance_to_image / lens.focal_length - 1


def _draw_breathing(axes: "Axes", lens: PrescriptionLens) -> None:
    """Draw the paraxial enlargement of the picture with nearer focus."""
    distance, enlargement = _breathing(lens)
    axes.plot(distance / 1000, 100 * enlargement, color=_COLORS[2])
    axes.set_xscale("log")
    _label(axes, "breathing: larger than at infinity, %", "focus, m")


def _draw_facts(axes: "Axes", lens: PrescriptionLens) -> None:
    facts = lens_facts(lens)
    keys = ("focal_length", "f_number", "working_f_number", "back_focus", "length", "half_angle")
    text = "\n".join(f"{key.replace('_', ' ')}  {facts[key]:.5g}" for key in (*keys, "focus_shift"))
    axes.axis("off")
    axes.text(0.02, 0.95, text, va="top", fontsize=10, transform=axes.transAxes)


def _draw_spots(part: Any, lens: PrescriptionLens) -> None:
    """Draw spots of three fields in planes through focus, for rays of three colours."""
    step = _plane_step(lens)
    pupil = 1.5 * disc_from_square(np.stack([halton(900, 2), halton(900, 3)], -1))
    part.suptitle(
        f"spots through focus, planes {2 * step:.3g} mm apart; F blue, d yellow, C red", fontsize=10
    )
    grid = part.subplots(3, len(_PLANES), sharex=True, sharey=True)
    limit = 0.0
    for row, field in zip(grid, FIELDS, strict=True):
        for wavelength, color in _LINES:
            rays = field_rays(lens, field, pupil, wavelength)
            middle = rays.place[rays.passes].mean(0)
            for axes, plane in zip(row, _PLANES, strict=True):
                at = 1000 * (rays.place + plane * step * rays.slope - middle)[rays.passes]
                axes.scatter(at[:, 1], at[:, 0], s=1.5, lw=0, color=color, alpha=0.5)
                limit = max(limit, float(np.quantile(np.abs(at), 0.98)))
    for axes in grid.ravel():
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit))
        axes.set_box_aspect(1)
        axes.tick_params(labelsize=6)
        axes.grid(lw=0.3)
    grid[0][0].set_ylabel("middle, µm", fontsize=8)
    grid[1][0].set_ylabel("0.7", fontsize=8)
    grid[2][0].set_ylabel("corner", fontsize=8)


def _blurs(blur_at_infinity: float) -> tuple[float, ...]:
    """Return five blurs, + in front of focus, none beyond the blur at infinity, ``blur_at_infinity``."""
    if blur_at_infinity > -_MIN_BLUR:  # almost no depth lies behind the focus
        return (_MAX_BLUR, 0.75 * _MAX_BLUR, 0.5 * _MAX_BLUR, 0.25 * _MAX_BLUR, 0.0)
    far_blur = max(-_MAX_BLUR, blur_at_infinity)
    return (_MAX_BLUR, 0.5 * _MAX_BLUR, 0.0, 0.5 * far_blur, far_blur)


def _draw_bokeh(part: Any, lens: PrescriptionLens) -> None:
    """Draw discs of white lamps, right of the centre of the picture, in front of focus and behind it."""
    half, focus = lens.prescription.image_radius, 1 / lens.focus_distance
    per_disparity = float(lens.coc_radius(1.0) - lens.coc_radius(0.0))
    blur_at_infinity = 100 * float(lens.coc_radius(0.0)) / half
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    part.suptitle("bokeh: lamps in front of focus (left) to behind it (right), as traced", fontsize=10)
    grid = part.subplots(3, 5)
    for column, blur in enumerate(_blurs(blur_at_infinity)):
        depth = 1 / max(focus + blur / 100 * half / per_disparity, 1e-9)
        for row, field in enumerate((0.0, 0.5, 0.9)):
            axes = grid[row][column]
            axes.set_xticks([])
            axes.set_yticks([])
            if depth <= 1.05 * lens.front_vertex:
                continue
            image = traced_psf(
                lens,
                PsfGrid(
                    wavelengths=wavelengths,
                    colors=colors,
                    pitch=max(2.8 * abs(blur), 2.5) / 100 * half / _CELLS,
                    size=_CELLS,
                    rays=_RAYS,
                ),
                depth=depth,
                field=(field, 0.0),
            )
            bright = np.quantile(image[image > 0], 0.9) if (image > 0).any() else 1.0
            axes.imshow(np.clip(image / bright * 0.7, 0, 1) ** (1 / 2.2))
            if row == 0:
                axes.set_title(f"{depth / 1000:.3g} m" if depth < 1e8 else "infinity", fontsize=8)
    for axes, name in zip(grid[:, 0], ("middle", "0.5", "0.9"), strict=True):
        axes.set_ylabel(name, fontsize=8)
