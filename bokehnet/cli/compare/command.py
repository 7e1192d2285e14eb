"""``bokehnet compare``: one picture rendered by several engines, as a sheet and as a page with a slider."""

from pathlib import Path

import click

from bokehnet.cli.options import COMMON_OPTIONS, OptionValues, with_options
from bokehnet.cli.parser import SectionedCommand, argument
from bokehnet.errors import ParameterError
from bokehnet.settings.engine_settings import EngineSettings, OutputSettings
from bokehnet.settings.settings import RenderSettings, group_types

__all__ = ["compare"]

_COMMON = COMMON_OPTIONS | {
    "output": "Output file of the sheet.",
    "truth": "Reference picture; adds scores and error images.",
    "engines": "Engines or methods of the literature, joined by commas.",
    "crop": "Crop to show, pixels.",
    "html": "Web page that compares two pictures with a slider.",
}


@click.command(cls=SectionedCommand, common=_COMMON)
@argument("image", metavar="IMAGE", help="All-in-focus picture, as for render.")
@click.option("--output", "-o", required=True, metavar="FILE", help="Output file of the sheet.")
@click.option(
    "--engines",
    default="scatter,rays",
    metavar="NAME,...",
    help="Engines or methods of the literature, joined by commas.",
)
@click.option("--truth", metavar="FILE", help="Reference picture; adds scores and error images.")
@click.option(
    "--crop", metavar="X,Y,W,H", help="Crop to show, pixels. Default: the two regions that differ most."
)
@click.option(
    "page",
    "--html",
    metavar="FILE",
    help="Output file of a web page that compares two pictures with a slider.",
)
@with_options([group for group in group_types() if group not in (EngineSettings, OutputSettings)])
def compare(
    image: str,
    output: str,
    engines: str,
    truth: str | None,
    crop: str | None,
    page: str | None,
    option_values: OptionValues,
) -> None:
    """Render a picture with several engines, shown side by side.

    Prints one line per engine: PSNR, edge PSNR, SSIM and FLIP (with --truth), seconds and memory.
    """
    from bokehnet.cli.compare.page import comparison_page  # after parsing, so --help stays fast
    from bokehnet.cli.progress import compile_notice, progress
    from bokehnet.io.files.atomic import check_target, write_text
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.scene.focus_checks import check_focus
    from bokehnet.scene.scene import read_scene
    from bokehnet.tools.comparison import compare_engines, comparison_sheet, largest_difference_crops

    settings = RenderSettings().updated(option_values)
    check_focus(settings)
    check_writable(output)
    if page is not None:
        check_target(page)
    names = [name.strip() for name in engines.split(",") if name.strip()]
    scene = read_scene(Path(image), settings)
    reference = None if truth is None else read_image(truth)
    place = None if crop is None else _place(crop, *scene.image.shape[:2])
    try:
        with compile_notice(), progress("rendering", counted=False) as report:
            results = compare_engines(scene, settings, names, reference, report)
    except ParameterError as error:
        if error.parameter != "engines":
            raise
        raise error.renamed("--engines") from error
    places = largest_difference_crops(results) if place is None else [place]
    write_image(output, comparison_sheet(scene.image, results, places, reference))
    if page is not None:
        write_text(page, comparison_page(scene.image, results, reference))
    for result in results:
        click.echo(result.line)


def _place(text: str, height: int, width: int) -> tuple[int, int, int, int]:
    try:
        left, top, across, down = (int(word) for word in text.split(","))
    except ValueError:
        raise ParameterError("--crop", "four whole numbers X,Y,W,H", text) from None
    inside = left >= 0 and top >= 0 and across > 0 and down > 0
    if not inside or left + across > width or top + down > height:
        raise ParameterError("--crop", f"a part of the picture's {width}x{height} pixels", text)
    return left, top, across, down
