"""``bokehnet lens copy``: misaligned copies of a lens, as manufactured, and their image errors."""

import json
import math
from pathlib import Path
from typing import Any

import click

from bokehnet.cli.parser import PATH, SectionedCommand, argument
from bokehnet.errors import ConfigError, ParameterError

__all__ = ["copy"]

# Maximum number of copies in one run.
_MAX_COPIES = 1000


@click.command(cls=SectionedCommand)
@argument("name", help="Name in the catalog, or a lens file.")
@click.option("--output", "-o", type=PATH, help="Output file of the copy, a lens file, .toml.")
@click.option(
    "--copy-to-copy",
    type=float,
    default=1.0,
    help="Factor on the tolerances below: 0 is the design, 1 (default) the tolerances.",
)
@click.option("--seed", type=int, default=0, help="Number of the copy, from 0.")
@click.option("--copies", type=int, default=1, help="Number of copies to analyse, starting with --seed.")
@click.option("--decentre", type=float, default=0.02, help="Tolerance of the decentre of elements, mm.")
@click.option("--tilt", type=float, default=0.02, help="Tolerance of the tilt of elements, degrees.")
@click.option("--spacing", type=float, default=0.02, help="Tolerance of the air gaps, mm.")
@click.option("--focal", type=float, help="Focal length to scale the lens to, mm.")
@click.option("--f-number", type=float, help="F-number to stop down to. Default: wide open.")
@click.option(
    "--focus", type=float, help="Focus distance, metres from the entrance pupil. Default: infinity."
)
@click.option("as_json", "--json", is_flag=True, help="Print the numbers as JSON.")
def copy(
    name: str,
    output: Path | None,
    copy_to_copy: float,
    seed: int,
    copies: int,
    decentre: float,
    tilt: float,
    spacing: float,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
    as_json: bool,
) -> None:
    """Misalign the elements of a lens and print the effects.

    The errors are those of manufactured copies.
    """
    from bokehnet.io.files.atomic import check_target, write_text
    from bokehnet.lenses.assembly.misalignment import misalignment
    from bokehnet.lenses.assembly.tolerances import Tolerances, assemble_copy
    from bokehnet.lenses.catalog import load_lens
    from bokehnet.lenses.prescription_toml import prescription_toml

    if not 1 <= copies <= _MAX_COPIES:
        raise ParameterError("--copies", expected=f"1 to {_MAX_COPIES}", got=copies)
    if output is not None:
        if output.suffix.lower() != ".toml":
            raise ParameterError("--output", expected="a file that ends in .toml", got=str(output))
        if copies > 1:
            raise ParameterError("--output", expected="one copy", shown=f"--copies {copies}")
        check_target(output, error=ConfigError)
    if not 0 <= copy_to_copy < math.inf:
        raise ParameterError("--copy-to-copy", expected="0 or more", got=copy_to_copy)
    limits = Tolerances(decentre=decentre, tilt=tilt, spacing=spacing) * copy_to_copy
    distance = math.inf if focus is None else 1000 * focus
    design = load_lens(name, focal_length=focal, f_number=f_number, focus_distance=distance)
    rows = [_row("design", design, misalignment(design))]
    copied = None
    for number in range(seed, seed + copies):
        copied = _with_iris_of(design, assemble_copy(design.prescription, limits, number))
        rows.append(_row(f"copy {number}", copied, misalignment(copied)))
    if output is not None and copied is not None:
        write_text(output, prescription_toml(copied.prescription), error=ConfigError)
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    click.echo(f"{design.prescription.name}, {design.focal_length:.4g} mm f/{design.thick.f_number:.3g}")
    heads = (
        "",
        "focal, mm",
        "image shift, µm",
        "image tilt, '",
        "coma, µm",
        "spot, µm",
        "at 0.7, µm",
    )
    lines = [heads, *(_cells(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(heads))]
    for line in lines:
        click.echo("  ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())


def _with_iris_of(design: Any, prescription: Any) -> Any:
    """Return the copy stopped down like the design, as far as possible: gaps change its f-number slightly."""
    from bokehnet.lenses.prescription import PrescriptionLens

    wide_open = PrescriptionLens(prescription=prescription)
    stopped = None if design.f_number is None else max(design.f_number, wide_open.min_f_number)
    return PrescriptionLens(prescription=prescription, f_number=stopped, focus_distance=design.focus_distance)


def _row(label: str, lens: Any, errors: Any) -> dict[str, Any]:
    """Return the image errors of a copy, mm; ``image_lean`` is the tilt of its image plane, degrees."""
    cone = 2 * lens.working_f_number
    return {
        "lens": label,
        "focal_length": lens.focal_length,
        "moved": list(errors.image_shift),
        "image_lean": [math.degrees(math.atan(cone * part)) for part in errors.focus_tilt],
        "coma": list(errors.coma),
        "spot": errors.spot,
        "spots": list(errors.spots),
    }


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    moved, coma = (1000 * math.hypot(*row[key]) for key in ("moved", "coma"))
    return (
        row["lens"],
        f"{row['focal_length']:.4f}",
        f"{moved:.1f}",
        f"{60 * math.hypot(*row['image_lean']):.2f}",
        f"{coma:.2f}",
        f"{1000 * row['spot']:.2f}",
        f"{1000 * min(row['spots']):.1f} to {1000 * max(row['spots']):.1f}",
    )
