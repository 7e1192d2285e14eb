"""``bokehnet export``: an engine as one ONNX file."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["export"]


def export(
    output: Annotated[Path, typer.Option("--output", "-o", help="Output file, .onnx.")],
    engine: Annotated[str, typer.Option(help="Engine: fast, or neural (better and slower).")] = "fast",
    weights: Annotated[
        Path | None,
        typer.Option(
            help="Folder with networks to use in place of the shipped ones; they must correct engine scatter."
        ),
    ] = None,
    full: Annotated[bool, typer.Option("--full", hidden=True)] = False,  # no effect; for older scripts
) -> None:
    """Write an engine as one ONNX file: inputs image, disparity, K, focus, gamma; output bokeh."""
    from bokehnet.checks import require_extra  # after parsing, so --help stays fast
    from bokehnet.errors import ModelFileError
    from bokehnet.io.atomic import check_target

    check_target(output, error=ModelFileError)
    require_extra("onnx", "train")
    from bokehnet.cli.progress import compile_notice, progress
    from bokehnet.onnx_file.renderer import export_renderer

    with compile_notice(), progress("verifying") as report:
        parity = export_renderer(output, weights, report, engine=engine)
    size = output.stat().st_size / 1e6
    typer.echo(f"wrote {output}: {size:.1f} MB, PSNR of at least {parity:.0f} dB against engine {engine}")
