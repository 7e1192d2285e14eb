"""``bokehnet lens``: what is known of a lens, and its picture."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    from bokehnet.lenses.prescription import PrescriptionLens

__all__ = ["lens"]


def lens(
    name: Annotated[
        str | None,
        typer.Argument(help="Name in the catalog, or a TOML file; without one the catalog is listed."),
    ] = None,
    focal: Annotated[float | None, typer.Option(help="Scale the lens to this focal length, mm.")] = None,
    f_number: Annotated[float | None, typer.Option(help="Stop down to this f-number.")] = None,
    focus: Annotated[
        float | None, typer.Option(help="Focus at this depth, metres from the entrance pupil.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw lens, spots and depth of field here.")] = None,
    psf_sheet: Annotated[
        Path | None,
        typer.Option(help="Draw blur of points here: traced beside reduced, over field and depth."),
    ] = None,
) -> None:
    """Tell focal length, pupils and light of a lens, or list the catalog."""
    from bokehnet.lenses.catalog import catalog_names, find_prescription, load_lens

    if name is None:
        if (focal, f_number, focus, plot, psf_sheet) != (None,) * 5:
            raise ParameterError("expected the name of a lens or a TOML file with these options, found none")
        names = catalog_names()
        width = max(map(len, names))
        for entry in names:
            found = find_prescription(entry)
            typer.echo(f"  {entry:<{width}}  {found.focal_length:g} mm f/{found.f_number:g}, {found.name}")
        return
    focus_distance = math.inf if focus is None else 1000 * focus
    chosen = load_lens(name, focal_length=focal, f_number=f_number, focus_distance=focus_distance)
    rows = _describe(chosen)
    if plot is not None:
        from bokehnet.lenses.plot import plot_lens

        plot_lens(chosen, plot)
    if psf_sheet is not None:
        rows["blur of points"] = _draw_psfs(chosen, psf_sheet)
    width = max(map(len, rows))
    typer.echo(chosen.prescription.name)
    for label, text in rows.items():
        typer.echo(f"  {label:<{width}}  {text}")


def _draw_psfs(lens: "PrescriptionLens", path: Path) -> str:
    """Write the sheet and say how well reduced and traced blur agree."""
    from bokehnet.cli.progress import progress
    from bokehnet.cli.psf_sheet import write_psf_sheet
    from bokehnet.io.image import check_writable

    check_writable(path)
    with progress("tracing") as report:
        pairs = write_psf_sheet(lens, path, report)
    found = [pair.correlation for pair in pairs]
    return f"reduced against traced: correlation {sum(found) / len(found):.3f}, worst {min(found):.3f}"


def _describe(lens: "PrescriptionLens") -> dict[str, str]:
    """Label and text of each line; places are mm behind the first surface."""
    import dataclasses

    from bokehnet.lenses.depth_of_field import depth_of_field
    from bokehnet.lenses.plot import sharp_radius
    from bokehnet.lenses.pupils import traced_focal_length, traced_pupils
    from bokehnet.lenses.unvignetted_fraction import unvignetted_fraction

    paraxial, cardinal, design = lens.paraxial, lens.paraxial.cardinal, lens.prescription
    traced = traced_focal_length(lens.surfaces, 0.05 * abs(paraxial.entrance.radius))
    pupils = {}
    for label, by_matrix, by_ray in zip(
        ("entrance pupil", "exit pupil"),
        (paraxial.entrance, paraxial.exit),
        traced_pupils(lens.surfaces, zone=0.1),
        strict=True,
    ):
        pupils[label] = (
            f"at {by_matrix.position:.3f} mm, radius {abs(by_matrix.radius):.3f} mm by imaging; "
            f"{by_ray.position:.3f}, {abs(by_ray.radius):.3f} by rays"
        )
    limit = sharp_radius(lens)
    near, far = (_metres(depth) for depth in depth_of_field(lens, limit))
    exit_only = dataclasses.replace(lens, pupil_sampling="exit")
    shares = [
        f"{100 * unvignetted_fraction(one, field * design.image_radius):.0f}"
        for one in (exit_only, lens)
        for field in (0.0, 0.7, 1.0)
    ]
    return {
        "source": design.source,
        "focal length": f"{lens.focal_length:.3f} mm by matrix, {traced:.3f} mm traced; "
        f"published {design.focal_length:.4g}",
        "f-number": f"{lens.thick.f_number:.3f}, fully open {lens.fastest:.3f}",
        "principal planes": f"at {cardinal.front_principal:.3f} and {cardinal.rear_principal:.3f} mm",
        "focal points": f"at {cardinal.front_focus:.3f} and {cardinal.rear_focus:.3f} mm",
        **pupils,
        "back focal distance": f"{cardinal.rear_focus - paraxial.length:.3f} mm",
        "focus": f"{_metres(lens.focus_distance)} from the entrance pupil, "
        f"sensor at {lens.sensor_position:.3f} mm, "
        f"travel {lens.sensor_position - cardinal.rear_focus:.3f} mm",
        "depth of field": f"{near} to {far} for a blur radius of {limit:.4f} mm",
        "rays that pass": f"{'/'.join(shares[:3])} % aimed at the exit pupil, "
        f"{'/'.join(shares[3:])} % at the effective pupil (centre/0.7/edge of {design.image_radius:g} mm)",
    }


def _metres(depth: float) -> str:
    return "infinity" if math.isinf(depth) else f"{depth / 1000:.4g} m"
