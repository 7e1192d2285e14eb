"""``bokehnet export``: the renderer as a file for any ONNX Runtime."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["export"]


def export(
    output: Annotated[Path, typer.Option("--output", "-o", help="The ONNX file to write.")],
    engine: Annotated[str, typer.Option(help="What renders: fast, or neural, better and slower.")] = "fast",
    weights: Annotated[
        Path | None, typer.Option(help="Folder with other networks; they must correct the scatter.")
    ] = None,
    full: Annotated[bool, typer.Option("--full", hidden=True)] = False,  # older scripts; changes nothing
) -> None:
    """Write an engine as one ONNX file (image, disparity, K, focus, gamma to bokeh)."""
    from bokehnet.checks import require_extra  # after parsing, so --help stays fast
    from bokehnet.errors import ModelFileError
    from bokehnet.io.atomic import check_target

    check_target(output, error=ModelFileError)
    require_extra("onnx", "train")
    from bokehnet.cli.progress import compile_notice, progress
    from bokehnet.onnx_file.renderer import export_renderer

    with compile_notice(), progress("proving") as report:
        parity = export_renderer(output, weights, report, engine=engine)
    size = output.stat().st_size / 1e6
    typer.echo(f"wrote {output}: {size:.1f} MB, {parity:.0f} dB or more to the engine {engine}")
