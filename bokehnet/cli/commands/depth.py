"""``bokehnet depth``: disparity of a photo from a network or from its own file."""

from pathlib import Path

import click

from bokehnet.cli.parser import PATH, SectionedCommand, argument
from bokehnet.errors import ParameterError

__all__ = ["depth"]

_MM_PER_M = 1000.0


@click.command(cls=SectionedCommand)
@argument("image", type=PATH, help="Photo, HEIC included; EXR and HDR are read as linear.")
@click.option(
    "--output",
    "-o",
    type=PATH,
    required=True,
    help="Output: EXR, or PNG for relative disparity; near is bright.",
)
@click.option(
    "--model",
    type=PATH,
    metavar="NAME|FILE.onnx",
    help="Depth network: an ONNX file, or a name listed by `bokehnet models`. Default: the map in "
    "a phone's photo.",
)
@click.option(
    "--convention",
    metavar="NAME|FILE.toml",
    help="Input and output format of an ONNX file as --model: depth-anything-v2 (default), "
    "depth-anything-v2-metric, midas, midas-dpt, depth-pro, moge-2 and others, or a TOML file.",
)
@click.option("--threads", type=click.IntRange(min=0), default=0, help="Number of threads; 0 uses all cores.")
def depth(
    image: Path,
    output: Path,
    model: Path | None,
    convention: str | None,
    threads: int,
) -> None:
    """Write the disparity map of a photo.

    A network estimates it, or a phone has stored it in the photo. Relative disparity ranges from 0 (far) to
    1 (near); metric disparity is in 1/m.
    """
    # After parsing, so that --help stays fast.
    from bokehnet.arrays.resample import resample
    from bokehnet.cli.commands.models import ensure_model
    from bokehnet.cli.progress import progress
    from bokehnet.io.image import MAP_EXTENSIONS, check_writable, write_map
    from bokehnet.scene.depth.depth_source import DepthSource, EmbeddedDepth, NetworkDepth
    from bokehnet.scene.scene import read_scene

    check_writable(output, MAP_EXTENSIONS)
    source: DepthSource
    if model is not None:
        ensure_model(model)
        source = NetworkDepth(model=model, convention=convention or "", threads=threads)
    elif convention is None:
        source = EmbeddedDepth()
    else:
        expected, remedy = "--model for it to act on", "give that, or leave this out"
        raise ParameterError("--convention", expected, convention, remedy)
    _check_extension(output, source.kind)
    try:
        with progress("estimating depth") as report:
            report(0, 1)
            scene = read_scene(image, source=source, progress=report)
            report(1, 1)
    except ParameterError as error:
        if error.parameter != "input.disparity":
            raise
        expected = f"a network, since {image} has no depth map"
        raise ParameterError(
            "--model",
            expected,
            shown="none",
            remedy="give an ONNX file, or a name listed by `bokehnet models`",
        ) from error
    _check_extension(output, scene.depth.kind)
    metric = scene.depth.kind == "metric"
    values, size = scene.depth.values, scene.image.shape[:2]
    if values.shape != size:
        values = resample(values, *size)
    write_map(output, values * _MM_PER_M if metric else values, channel="disparity")
    if metric:
        click.echo(f"wrote {output}: metric disparity, use it as --depth {output} --depth-unit 1/m")


def _check_extension(output: Path, kind: str | None) -> None:
    if kind == "metric" and output.suffix.lower() != ".exr":
        raise ParameterError("--output", expected=".exr, which metric disparity needs", got=output.suffix)
