"""``bokehnet demo``: the picture that ships with the package, at three focus distances."""

from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli.engine_option import DEFAULT_ENGINE, Engine

__all__ = ["ASSETS", "BLUR", "FOCUS", "demo"]

# Holds demo.png and demo_disparity.png, traced by examples/demo_scene.py.
ASSETS = Path(__file__).parent.parent / "assets"

BLUR = 38.0  # pixels of radius per unit of disparity
FOCUS = {"near": 0.94, "middle": 0.46, "far": 0.0}  # leaves, cat, town


def demo(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Where the contact sheet goes; its extension picks the format."),
    ] = Path("bokehnet_demo.png"),
    engine: Engine = DEFAULT_ENGINE,
) -> None:
    """Render a picture that comes with the package at three focus distances, as one contact sheet."""
    from bokehnet.cli.progress import progress  # after parsing, so --help stays fast
    from bokehnet.cli.sheet import contact_sheet
    from bokehnet.inference.pipeline import BokehRenderer
    from bokehnet.io.color import srgb_to_linear
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.io.maps import read_disparity
    from bokehnet.optics.coc import defocus_from_disparity

    check_writable(output)
    renderer = BokehRenderer(engine)
    picture = read_image(ASSETS / "demo.png")
    disparity = read_disparity(ASSETS / "demo_disparity.png")
    shown = srgb_to_linear(disparity)  # so that a viewer sees the stored values
    grey = shown[..., None].repeat(3, axis=-1)
    results = []
    with progress("rendering") as report:
        for index, (name, focus) in enumerate(FOCUS.items()):
            report(index, len(FOCUS))
            defocus = defocus_from_disparity(disparity, BLUR, focus)
            results.append((f"focus {name} ({focus:.2f})", renderer.render(picture, defocus).bokeh))
        report(len(FOCUS), len(FOCUS))
    write_image(output, contact_sheet([[("input", picture), ("disparity, near is bright", grey)], results]))
    typer.echo(f"wrote {output}: the input, its disparity and three focus distances (engine {engine})")
