"""``bokehnet lens copy``: one copy of a lens as it is put together, or what many of them do."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from bokehnet.errors import ConfigError, ParameterError

__all__ = ["copy"]

# Copies that can be told of in one run.
_MOST = 1000


def copy(
    name: Annotated[str, typer.Argument(help="Name in the catalog, or a lens file.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the copy here, .toml, a lens file.")
    ] = None,
    copy_to_copy: Annotated[
        float, typer.Option(help="The slider: 0 is the design, 1 the limits below, more of them above.")
    ] = 1.0,
    seed: Annotated[int, typer.Option(help="Which copy, from 0 up.")] = 0,
    copies: Annotated[int, typer.Option(help="Tell of so many copies, from --seed on.")] = 1,
    decentre: Annotated[float, typer.Option(help="Of elements from the axis at most, mm.")] = 0.02,
    tilt: Annotated[float, typer.Option(help="Of elements at most, degrees.")] = 0.02,
    spacing: Annotated[float, typer.Option(help="Of gaps of air at most, mm longer or shorter.")] = 0.02,
    focal: Annotated[float | None, typer.Option(help="Scale the lens to this focal length, mm.")] = None,
    f_number: Annotated[float | None, typer.Option(help="Stop down to this f-number.")] = None,
    focus: Annotated[
        float | None, typer.Option(help="Focus at this depth, metres from the entrance pupil.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Numbers as JSON.")] = False,
) -> None:
    """Put elements a little off their places, as in one copy of a lens, and tell what that does."""
    from bokehnet.io.atomic import check_target, write_text
    from bokehnet.lenses.assembly.misalignment import misalignment
    from bokehnet.lenses.assembly.tolerances import Tolerances, assembled
    from bokehnet.lenses.catalog import load_lens
    from bokehnet.lenses.prescription_toml import prescription_toml

    if not 1 <= copies <= _MOST:
        raise ParameterError("--copies", expected=f"1 to {_MOST}", got=copies)
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
    made = None
    for number in range(seed, seed + copies):
        made = _at_work(design, assembled(design.prescription, limits, number))
        rows.append(_row(f"copy {number}", made, misalignment(made)))
    if output is not None and made is not None:
        write_text(output, prescription_toml(made.prescription), error=ConfigError)
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    typer.echo(f"{design.prescription.name}, {design.focal_length:.4g} mm f/{design.thick.f_number:.3g}")
    heads = (
        "",
        "focal, mm",
        "picture moved, µm",
        "image leans, '",
        "coma, µm",
        "spot, µm",
        "at 0.7, µm",
    )
    lines = [heads, *(_told(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(heads))]
    for line in lines:
        typer.echo("  ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())


def _at_work(design: Any, prescription: Any) -> Any:
    """The copy, the iris as it is in the design: gaps change the f-number a little."""
    from bokehnet.lenses.prescription import PrescriptionLens

    made = PrescriptionLens(prescription=prescription)
    stopped = None if design.f_number is None else max(design.f_number, made.fastest)
    return PrescriptionLens(prescription=prescription, f_number=stopped, focus_distance=design.focus_distance)


def _row(label: str, lens: Any, found: Any) -> dict[str, Any]:
    """Numbers of a copy, mm; the sensor that would be sharp on all sides leans by so many degrees."""
    cone = 2 * lens.working_f_number
    return {
        "lens": label,
        "focal_length": lens.focal_length,
        "moved": list(found.moved),
        "image_lean": [math.degrees(math.atan(cone * part)) for part in found.lean],
        "coma": list(found.coma),
        "spot": found.spot,
        "spots": list(found.spots),
    }


def _told(row: dict[str, Any]) -> tuple[str, ...]:
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
