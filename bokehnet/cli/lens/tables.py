"""``bokehnet lens aberrations``, ``preset``, ``profile``, ``transfer``: lenses as tables and presets."""

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import Any, Literal

import click

from bokehnet.cli.parser import PATH, SectionedCommand, argument
from bokehnet.errors import ConfigError, ParameterError

__all__ = ["aberrations", "preset", "profile", "transfer"]

_name = argument("name", help="Name in the catalog, or a lens file.")
_focal = click.option("--focal", type=float, help="Focal length to scale the lens to, mm.")
_f_number = click.option("--f-number", type=float, help="F-number to stop down to. Default: wide open.")
_focus = click.option(
    "--focus", type=float, help="Focus distance, metres from the entrance pupil. Default: infinity."
)


@click.command(cls=SectionedCommand)
@_name
@click.option("--output", "-o", type=PATH, required=True, help="Output file of the table, .csv.")
@click.option(
    "--theory",
    type=click.Choice(("traced", "seidel")),
    default="traced",
    help="Rays through the glass (traced), or third-order theory at 64 wavelengths (seidel).",
)
@_focal
@_f_number
@_focus
def aberrations(
    name: str,
    output: Path,
    theory: Literal["traced", "seidel"],
    focal: float | None,
    f_number: float | None,
    focus: float | None,
) -> None:
    """Write the aberrations of a lens as a table by wavelength.

    `bokehnet render --aberration-table` reads it.
    """
    from bokehnet.io.files.atomic import check_target, write_text
    from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
    from bokehnet.lenses.aberrations.aberration_table import aberration_table
    from bokehnet.lenses.seidel_lens import seidel_aberration_map

    check_target(output, error=ConfigError)
    lens = _load(name, focal, f_number, focus)
    table = seidel_aberration_map(lens) if theory == "seidel" else fit_aberration_map(lens)
    write_text(output, aberration_table(table, _remarks(lens)), error=ConfigError)
    wavelengths, rims = len(table.wavelengths), len(table.vignetting_apertures)
    click.echo(f"wrote {output}: {wavelengths} wavelengths, {rims} vignetting apertures")


@click.command(cls=SectionedCommand)
@_name
@click.option(
    "--output",
    "-o",
    type=PATH,
    required=True,
    help="Output file of the preset, .toml; adds a .csv of the same name.",
)
@_focal
@_f_number
@_focus
def preset(
    name: str,
    output: Path,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
) -> None:
    """Convert a lens to a preset.

    The preset holds a table of its aberrations, and its vignetting.
    """
    from bokehnet.cli.progress import progress
    from bokehnet.io.files.atomic import check_target, write_text
    from bokehnet.lenses.aberrations.aberration_table import aberration_table
    from bokehnet.lenses.aberrations.lens_preset import lens_preset

    if output.suffix.lower() != ".toml":
        raise ParameterError("--output", expected="a file that ends in .toml", got=str(output))
    table = output.with_suffix(".csv")
    for path in (output, table):
        check_target(path, error=ConfigError)
    lens = _load(name, focal, f_number, focus)
    with progress("tracing", counted=False) as report:
        report(0, 1)
        look = lens_preset(lens)
        report(1, 1)
    title = f"{lens.prescription.name}, {lens.focal_length:.4g} mm f/{lens.thick.f_number:.3g}"
    description = (
        f"{title}: correlation with traced points {look.correlation:.3f}, worst {look.min_correlation:.3f}"
    )
    escaped = "".join(c for c in description if c.isprintable()).replace("\\", "\\\\").replace('"', '\\"')
    file = table.name.replace("\\", "\\\\").replace('"', '\\"')
    lines = [f'description = "{escaped}"', f'aberration-table = "{file}"']
    if abs(look.vignette.stops) > 1e-3:
        lines += [
            f"vignette = {look.vignette.stops:.4f}",
            f"vignette-radius = {look.vignette.radius:.4f}",
            f"vignette-softness = {look.vignette.softness:.4f}",
        ]
    write_text(table, aberration_table(look.aberrations, _remarks(lens)), error=ConfigError)
    write_text(output, "\n".join([*lines, ""]), error=ConfigError)
    click.echo(description)
    click.echo(
        f"  largest error of the vignetting: {100 * look.light_error:.2g} % of the light at the centre"
    )


@click.command(cls=SectionedCommand)
@_name
@click.option("--output", "-o", type=PATH, help="Output file of the table, .npz, usable as a lens file.")
@click.option("--degree", type=int, default=4, help="Degree of the polynomials, 1 to 8.")
@click.option("--one-colour", is_flag=True, help="Use only the design wavelength instead of 400 to 700 nm.")
@_focal
@_f_number
@_focus
def transfer(
    name: str,
    output: Path | None,
    degree: int,
    one_colour: bool,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
) -> None:
    """Fit the ray transfer function of a lens and store it.

    Prints its ray errors.
    """
    from bokehnet.io.files.atomic import check_target, write_atomic
    from bokehnet.lenses.lookup.transfer import TransferLens
    from bokehnet.lenses.lookup.transfer_file import transfer_errors, write_transfer
    from bokehnet.lenses.prescription import PrescriptionLens

    if not 1 <= degree <= 8:
        raise ParameterError("--degree", expected="1 to 8", got=degree)
    if output is not None:
        if output.suffix.lower() != ".npz":
            raise ParameterError("--output", expected="a file that ends in .npz", got=str(output))
        check_target(output, error=ConfigError)
    loaded = _load(name, focal, f_number, focus)
    fields = {item.name: getattr(loaded, item.name) for item in dataclasses.fields(PrescriptionLens)}
    lens = TransferLens(**fields, degree=degree, dispersive=not one_colour)
    if isinstance(loaded, TransferLens):
        lens = loaded
    rows = transfer_errors(lens)
    if output is not None:
        write_atomic(output, lambda path: _store(write_transfer, lens, path), error=ConfigError)
    click.echo(f"{lens.prescription.name}, degree {lens.degree}: {lens.table.coefficients.size} numbers")
    click.echo("  field       rms, µm   largest, µm   rays that differ")
    for row in rows:
        zone = f"{row.zone[0]:.1f} to {row.zone[1]:.1f}"
        click.echo(f"  {zone}{row.rms:9.3g}{row.largest:14.3g}{100 * row.disagreement:17.2g} %")


@click.command(cls=SectionedCommand)
@_name
@click.option("--output", "-o", type=PATH, help="Output file of the texture with its lens, .npz.")
@click.option("--rows", type=int, default=64, help="Number of image distances in the texture, 2 to 4096.")
@click.option("--columns", type=int, default=64, help="Number of radii in the texture, 2 to 4096.")
@_focal
@_f_number
@_focus
def profile(
    name: str,
    output: Path | None,
    rows: int,
    columns: int,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
) -> None:
    """Trace the profile texture of a lens and store it.

    Compares it with the aberration map.
    """
    from bokehnet.cli.progress import progress
    from bokehnet.io.files.atomic import check_target, write_atomic
    from bokehnet.lenses.lookup.profile_comparison import compare_profiles
    from bokehnet.lenses.lookup.profile_file import write_profile

    for flag, count in (("--rows", rows), ("--columns", columns)):
        if not 2 <= count <= 4096:
            raise ParameterError(flag, expected="2 to 4096", got=count)
    if output is not None:
        if output.suffix.lower() != ".npz":
            raise ParameterError("--output", expected="a file that ends in .npz", got=str(output))
        check_target(output, error=ConfigError)
    lens = _load(name, focal, f_number, focus)
    with progress("tracing", counted=False) as report:
        report(0, 1)
        texture, kinds = compare_profiles(lens, rows=rows, columns=columns)
        report(1, 1)
    if output is not None:
        write_atomic(
            output, lambda path: _store(partial(write_profile, texture), lens, path), error=ConfigError
        )
    click.echo(f"{lens.prescription.name}, {lens.focal_length:.4g} mm f/{lens.thick.f_number:.3g}")
    click.echo(f"  {'':<16}   bytes    build, s       blur, ms  error on the axis  at 0.5  at 0.9")
    for kind in kinds:
        near, half, far = kind.errors
        click.echo(
            f"  {kind.name:<16}{kind.bytes:8d}{kind.build_seconds:12.2f}{1000 * kind.blur_seconds:15.0f}"
            f"{near:19.4f}{half:8.4f}{far:8.4f}"
        )


def _store(write: Any, lens: Any, path: Path) -> None:
    with path.open("wb") as file:
        write(lens, file)


def _remarks(lens: Any) -> dict[str, str]:
    name = "".join(c for c in lens.prescription.name if c.isprintable())
    focus = "infinity" if math.isinf(lens.focus_distance) else f"{lens.focus_distance / 1000:.6g} m"
    return {
        "name": name,
        "focal_length": f"{lens.focal_length:.6g} mm",
        "f_number": f"{lens.thick.f_number:.6g}",
        "focus": focus,
    }


def _load(name: str, focal: float | None, f_number: float | None, focus: float | None) -> Any:
    from bokehnet.lenses.catalog import load_lens

    distance = math.inf if focus is None else 1000 * focus
    return load_lens(name, focal_length=focal, f_number=f_number, focus_distance=distance)
