"""``bokehnet export``: an engine as one ONNX file."""

from pathlib import Path

import click
from click.core import ParameterSource

from bokehnet.cli.parser import PATH, SectionedCommand

__all__ = ["export"]


@click.command(cls=SectionedCommand)
@click.option("--output", "-o", type=PATH, required=True, help="Output file, .onnx.")
@click.option(
    "--engine",
    default="fast",
    help="Engine: fast, neural (better and slower), rays (best at depth edges), or bokehme (baseline).",
)
@click.option(
    "--weights",
    type=PATH,
    help="Folder with networks to use in place of the shipped ones; they must correct engine scatter.",
)
@click.option(
    "--repair",
    is_flag=True,
    help="Write the repair of soft depth maps, no engine: inputs image, disparity; output repaired.",
)
@click.option("--full", is_flag=True, hidden=True)
@click.pass_context
def export(
    context: click.Context,
    output: Path,
    engine: str,
    weights: Path | None,
    repair: bool,
    full: bool,
) -> None:
    """Write an engine as one ONNX file.

    Inputs: image, disparity, K, focus, gamma; output: bokeh.
    """
    from bokehnet.checks import require_extra  # after parsing, so --help stays fast
    from bokehnet.errors import ModelFileError, ParameterError
    from bokehnet.io.files.atomic import check_target

    check_target(output, error=ModelFileError)
    if output.suffix.lower() != ".onnx":
        raise ModelFileError(f"{output}: unknown extension {output.suffix!r}, expected .onnx")
    for name in ("engine", "weights"):
        if repair and context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            raise ParameterError(f"--{name}", "none with --repair", shown=str(context.params[name]))
    require_extra("onnx")
    if repair:
        from bokehnet.onnx_file.depth_repair import export_repair

        agreement = export_repair(output)
        size = output.stat().st_size / 1e6
        click.echo(f"wrote {output}: {size:.2f} MB, {agreement:.1%} of a soft map repaired as by the package")
        return
    from bokehnet.cli.progress import compile_notice, progress
    from bokehnet.onnx_file.renderer import export_renderer

    with compile_notice(), progress("verifying") as report:
        parity = export_renderer(output, weights, report, engine=engine)
    size = output.stat().st_size / 1e6
    click.echo(f"wrote {output}: {size:.1f} MB, PSNR of at least {parity:.0f} dB against engine {engine}")
