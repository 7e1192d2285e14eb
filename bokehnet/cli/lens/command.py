"""``bokehnet lens``: data of a lens, import of lens files, comparison of two lenses."""

import json
import math
from pathlib import Path
from typing import Any

import click

from bokehnet.cli.lens.copy import copy
from bokehnet.cli.lens.fit import fit
from bokehnet.cli.lens.tables import aberrations, preset, profile, transfer
from bokehnet.cli.parser import PATH, SectionedCommand, argument
from bokehnet.errors import ParameterError

__all__ = ["lens"]


class _LensGroup(click.Group):
    """Group of lens commands; any other first word is the name of a lens to show."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if ctx.resilient_parsing and not args:  # completion of the first word
            return super().parse_args(ctx, args)
        if not args or (args[0] not in self.commands and args[0] not in ("-h", "--help")):
            args = ["show", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_LensGroup)
def lens() -> None:
    """Show, import, compare, fit and tabulate lenses. `bokehnet lens NAME` is `bokehnet lens show NAME`."""


_focal = click.option("--focal", type=float, help="Focal length to scale the lens to, mm.")
_f_number = click.option("--f-number", type=float, help="F-number to stop down to. Default: wide open.")
_focus = click.option(
    "--focus", type=float, help="Focus distance, metres from the entrance pupil. Default: infinity."
)
_paraxial = click.option(
    "--paraxial",
    is_flag=True,
    help="Focus paraxial rays, instead of minimising the blur of the full aperture.",
)
_sheet = click.option(
    "--output", "-o", type=PATH, help="Output file of the sheet: .html, .pdf, or an image such as .png."
)
# Extensions of sheets that are web pages; others are figures.
_PAGES = (".html", ".htm")
_json = click.option("as_json", "--json", is_flag=True, help="Print the numbers as JSON.")


@lens.command(cls=SectionedCommand)
@argument("name", required=False, help="Name in the catalog, or a lens file. Default: list the catalog.")
@_focal
@_f_number
@_focus
@_paraxial
@click.option("--plot", type=PATH, help="Output file of a plot: lens, spots and depth of field.")
@click.option(
    "--psf-sheet", type=PATH, help="Output file of a sheet of traced and modelled point spread functions."
)
def show(
    name: str | None,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
    paraxial: bool,
    plot: Path | None,
    psf_sheet: Path | None,
) -> None:
    """Print the data of a lens, or list the catalog.

    The data are focal length, pupils and light transmission.
    """
    from bokehnet.lenses.catalog import catalog_names, find_prescription
    from bokehnet.lenses.reports.report import describe_lens

    if name is None:
        if (focal, f_number, focus, plot, psf_sheet) != (None,) * 5:
            raise ParameterError("NAME", expected="a lens or a TOML file for these options", shown="none")
        names = catalog_names()
        width = max(map(len, names))
        for entry in names:
            listed = find_prescription(entry)
            click.echo(f"  {entry:<{width}}  {listed.focal_length:g} mm f/{listed.f_number:g}, {listed.name}")
        return
    loaded = _load(name, focal, f_number, focus, paraxial)
    rows = describe_lens(loaded)
    if plot is not None:
        from bokehnet.cli.progress import progress
        from bokehnet.io.image import check_writable
        from bokehnet.lenses.reports.plot import plot_lens
        from bokehnet.tools.figure_file import FIGURE_EXTENSIONS, write_figure

        check_writable(plot, FIGURE_EXTENSIONS)
        with progress("drawing", counted=False) as report:
            report(0, 1)
            write_figure(plot_lens(loaded), plot, dpi=130)
            report(1, 1)
    if psf_sheet is not None:
        rows["blur of points"] = _draw_psfs(loaded, psf_sheet)
    width = max(map(len, rows))
    click.echo(loaded.prescription.name)
    for label, text in rows.items():
        click.echo(f"  {label:<{width}}  {text}")


@lens.command("import", cls=SectionedCommand)
@argument(
    "file",
    type=PATH,
    help="Lens file: .zmx, .seq, .len, .json, .roa, .csv or .fx; FILE@2 is its second configuration.",
)
@click.option("--output", "-o", type=PATH, help="Output file, .toml.")
@click.option(
    "--glasses",
    type=PATH,
    multiple=True,
    help="Glass catalogue: AGF, YAML of refractiveindex.info, or a folder; repeatable.",
)
def import_file(
    file: Path,
    output: Path | None,
    glasses: tuple[Path, ...],
) -> None:
    """Read a lens file of another program, and convert it with -o.

    Prints a description of the lens. The output has bokehnet's format.
    """
    from bokehnet.errors import ConfigError
    from bokehnet.io.files.atomic import check_target, write_text
    from bokehnet.lenses.files.reading import import_lens
    from bokehnet.lenses.prescription import PrescriptionLens
    from bokehnet.lenses.prescription_toml import prescription_toml

    if output is not None:
        check_target(output, error=ConfigError)
    imported = import_lens(file, glasses or ())
    loaded = PrescriptionLens(prescription=imported.prescription)
    if output is not None:
        write_text(output, prescription_toml(imported.prescription), error=ConfigError)
    glass = sum(row.medium() is not None for row in imported.prescription.surfaces)
    click.echo(imported.prescription.name)
    click.echo(f"  {loaded.focal_length:.6g} mm f/{loaded.min_f_number:.4g}, {glass} glass elements")
    for sentence in imported.notes:
        click.echo(f"  {sentence}")
    if imported.skipped:
        ignored = ", ".join(f"{key} ({count})" for key, count in sorted(imported.skipped.items()))
        click.echo(f"  ignored: {ignored}")


@lens.command(cls=SectionedCommand)
@argument("first", help="Name in the catalog, or a lens file.")
@argument("second", help="Lens to compare it with.")
@_sheet
@_focal
@_f_number
@_focus
@_paraxial
@_json
def compare(
    first: str,
    second: str,
    output: Path | None,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
    paraxial: bool,
    as_json: bool,
) -> None:
    """Show two lenses side by side, as numbers or as sheets."""
    from bokehnet.lenses.reports.facts import lens_facts
    from bokehnet.lenses.reports.report_sheet import lens_curves

    if output is not None:
        _check_sheet(output)
    lenses = [_load(name, focal, f_number, focus, paraxial) for name in (first, second)]
    if output is not None:
        _write_sheet(lenses, output)
    if as_json:
        click.echo(json.dumps([lens_curves(one) for one in lenses], indent=2))
        return
    both = [lens_facts(one) for one in lenses]
    rows = [("", *(str(facts["name"]) for facts in both))]
    columns = [_flat(facts) for facts in both]
    rows += [(label, columns[0][label], columns[1][label]) for label in columns[0]]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    for row in rows:
        click.echo("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip())


@lens.command(cls=SectionedCommand)
@argument("name", help="Name in the catalog, or a lens file.")
@_sheet
@_focal
@_f_number
@_focus
@_paraxial
@_json
def report(
    name: str,
    output: Path | None,
    focal: float | None,
    f_number: float | None,
    focus: float | None,
    paraxial: bool,
    as_json: bool,
) -> None:
    """Draw all data of a lens on one sheet, or print it as JSON."""
    from bokehnet.lenses.reports.report_sheet import lens_curves

    if output is None and not as_json:
        raise ParameterError("--output", expected="a file for the sheet, or --json", shown="neither")
    if output is not None:
        _check_sheet(output)
    loaded = _load(name, focal, f_number, focus, paraxial)
    if output is not None:
        _write_sheet([loaded], output)
    if as_json:
        click.echo(json.dumps(lens_curves(loaded), indent=2))


def _check_sheet(output: Path) -> None:
    from bokehnet.io.image import check_writable
    from bokehnet.tools.figure_file import FIGURE_EXTENSIONS

    check_writable(output, (*_PAGES, *FIGURE_EXTENSIONS))


def _write_sheet(lenses: list[Any], output: Path) -> None:
    from bokehnet.cli.progress import progress
    from bokehnet.errors import ImageFileError
    from bokehnet.io.files.atomic import write_text
    from bokehnet.lenses.reports.report_sheet import report_figure, report_page
    from bokehnet.tools.figure_file import write_figure

    with progress("drawing", counted=False) as report_progress:
        report_progress(0, 1)
        if output.suffix.lower() in _PAGES:
            write_text(output, report_page(lenses), error=ImageFileError)
        else:
            write_figure(report_figure(lenses), output, dpi=110)
        report_progress(1, 1)


for _command in (copy, fit, aberrations, preset, profile, transfer):
    lens.add_command(_command)


def _flat(facts: dict[str, Any]) -> dict[str, str]:
    """Return label and text of each number: fields with their height, Seidel sums over all surfaces."""
    texts: dict[str, str] = {}
    for key, value in facts.items():
        label = key.replace("_", " ")
        if isinstance(value, dict):
            texts |= {f"{label}, {inner}": f"{number:.5g}" for inner, number in value.items()}
        elif key == "fields":
            for field, name in zip(value, ("middle", "0.7", "corner"), strict=True):
                for inner, number in field.items():
                    text = "none" if number is None else f"{number:.4g}"
                    texts[f"{inner.replace('_', ' ')}, {name}"] = text
        elif key == "seidel":
            for inner in [name for name in value[0] if name != "surface"]:
                texts[f"Seidel sum, {inner}"] = f"{sum(row[inner] for row in value):.4g}"
        elif not isinstance(value, str):
            texts[label] = "infinity" if value is None else f"{value:.5g}"
    return texts


def _load(name: str, focal: float | None, f_number: float | None, focus: float | None, paraxial: bool) -> Any:
    from bokehnet.lenses.catalog import load_lens

    return load_lens(
        name,
        focal_length=focal,
        f_number=f_number,
        focus_distance=math.inf if focus is None else 1000 * focus,
        focusing="paraxial" if paraxial else "sharpest",
    )


def _draw_psfs(lens: Any, path: Path) -> str:
    """Write the sheet and return the agreement of modelled and traced point spread functions."""
    from bokehnet.cli.progress import progress
    from bokehnet.io.image import check_writable
    from bokehnet.tools.psf_sheet import write_psf_sheet

    check_writable(path)
    with progress("tracing") as report:
        pairs = write_psf_sheet(lens, path, report)
    correlations = [pair.correlation for pair in pairs]
    mean, worst = sum(correlations) / len(correlations), min(correlations)
    return f"modelled against traced: correlation {mean:.3f}, worst {worst:.3f}"
