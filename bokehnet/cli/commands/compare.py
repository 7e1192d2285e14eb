"""``bokehnet compare``: one picture by several engines, as a sheet and as a page with a slider."""

from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli.options import Given, with_options
from bokehnet.errors import ParameterError
from bokehnet.settings.scene_settings import EngineSettings, OutputSettings
from bokehnet.settings.settings import RenderSettings, group_types

__all__ = ["compare"]


@with_options([group for group in group_types() if group not in (EngineSettings, OutputSettings)])
def compare(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="All-in-focus picture, as for render.")],
    output: Annotated[str, typer.Option("--output", "-o", metavar="FILE", help="Where the sheet goes.")],
    engines: Annotated[
        str, typer.Option(metavar="NAME,...", help="Engines, those of the literature included.")
    ] = "scatter,rays",
    truth: Annotated[
        str | None, typer.Option(metavar="FILE", help="What a lens sees: scores and errors are shown.")
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="What is shown; default: two places that differ most."),
    ] = None,
    page: Annotated[
        str | None,
        typer.Option("--html", metavar="FILE", help="A page that shows any two whole pictures by a slider."),
    ] = None,
    *,
    given: Given,
) -> None:
    """Render a picture by several engines, and lay them side by side.

    A line for each is printed: PSNR, edge PSNR, SSIM and FLIP where the truth is known, seconds and memory.
    """
    from bokehnet.cli.commands.compare_page import comparison_page  # after parsing, so --help stays fast
    from bokehnet.cli.progress import compile_notice, progress
    from bokehnet.io.atomic import check_target, write_text
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.scene.focus import check_focus
    from bokehnet.scene.scene import read_scene
    from bokehnet.tools.comparison import compare_engines, comparison_sheet, interesting_places

    settings = RenderSettings().updated(given)
    check_focus(settings)
    check_writable(output)
    if page is not None:
        check_target(page)
    names = [name.strip() for name in engines.split(",") if name.strip()]
    scene = read_scene(Path(image), settings)
    wanted = None if truth is None else read_image(truth)
    place = None if crop is None else _place(crop, *scene.image.shape[:2])
    try:
        with compile_notice(), progress("rendering", counted=False) as report:
            found = compare_engines(scene, settings, names, wanted, report)
    except ParameterError as error:
        if error.parameter != "engines":
            raise
        raise error.renamed("--engines") from error
    places = interesting_places(found) if place is None else [place]
    write_image(output, comparison_sheet(scene.image, found, places, wanted))
    if page is not None:
        write_text(page, comparison_page(scene.image, found, wanted))
    for one in found:
        typer.echo(one.line)


def _place(text: str, height: int, width: int) -> tuple[int, int, int, int]:
    try:
        left, top, across, down = (int(word) for word in text.split(","))
    except ValueError:
        raise ParameterError("--crop", "four whole numbers X,Y,W,H", text) from None
    inside = left >= 0 and top >= 0 and across > 0 and down > 0
    if not inside or left + across > width or top + down > height:
        raise ParameterError("--crop", f"a part of the picture's {width}x{height} pixels", text)
    return left, top, across, down
