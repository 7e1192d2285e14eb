"""``bokehnet lens``: what is known of a lens, and its picture."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from bokehnet.errors import ParameterError

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
    from bokehnet.lenses.report import describe_lens

    if name is None:
        if (focal, f_number, focus, plot, psf_sheet) != (None,) * 5:
            raise ParameterError("NAME", expected="a lens or a TOML file for these options", shown="none")
        names = catalog_names()
        width = max(map(len, names))
        for entry in names:
            found = find_prescription(entry)
            typer.echo(f"  {entry:<{width}}  {found.focal_length:g} mm f/{found.f_number:g}, {found.name}")
        return
    focus_distance = math.inf if focus is None else 1000 * focus
    chosen = load_lens(name, focal_length=focal, f_number=f_number, focus_distance=focus_distance)
    rows = describe_lens(chosen)
    if plot is not None:
        from bokehnet.cli.progress import progress
        from bokehnet.lenses.plot import plot_lens

        with progress("drawing", counted=False) as report:
            report(0, 1)
            plot_lens(chosen, plot)
            report(1, 1)
    if psf_sheet is not None:
        rows["blur of points"] = _draw_psfs(chosen, psf_sheet)
    width = max(map(len, rows))
    typer.echo(chosen.prescription.name)
    for label, text in rows.items():
        typer.echo(f"  {label:<{width}}  {text}")


def _draw_psfs(lens: Any, path: Path) -> str:
    """Write the sheet and say how well reduced and traced blur agree."""
    from bokehnet.cli.progress import progress
    from bokehnet.io.image import check_writable
    from bokehnet.rendering.psf_sheet import write_psf_sheet

    check_writable(path)
    with progress("tracing") as report:
        pairs = write_psf_sheet(lens, path, report)
    found = [pair.correlation for pair in pairs]
    return f"reduced against traced: correlation {sum(found) / len(found):.3f}, worst {min(found):.3f}"
