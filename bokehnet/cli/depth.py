"""``bokehnet depth``: disparity for a photo that comes without."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["depth"]

_MM_PER_M = 1000.0


def depth(
    image: Annotated[Path, typer.Argument(help="The photo, also HEIC; EXR and HDR are read as linear.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="EXR, or PNG for relative disparity; near is large.")
    ],
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.onnx", help="Network that guesses depth; default: the map inside a phone's photo."
        ),
    ] = None,
    convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.toml",
            help="What the network sees and returns: depth-anything-v2 (default), depth-anything-v2-metric, "
            "midas, midas-dpt or a file.",
        ),
    ] = None,
    threads: Annotated[int, typer.Option(min=0, help="Of the network; 0 takes all cores.")] = 0,
) -> None:
    """Write the disparity of a photo, guessed by a network or stored by a phone.

    Relative disparity runs from 0, far, to 1, near; metric disparity is in 1/m.
    """
    from bokehnet.io.image import (
        MAP_EXTENSIONS,
        check_writable,
        write_map,
    )  # after parsing, so --help stays fast

    if model is None and convention is not None:
        raise ParameterError("--convention needs --model")
    check_writable(output, MAP_EXTENSIONS)
    if model is None:
        values, metric = _stored(image, output)
    else:
        values, metric = _guessed(image, output, model, convention or "depth-anything-v2", threads)
    write_map(output, values * _MM_PER_M if metric else values, channel="disparity")
    if metric:
        typer.echo(f"wrote {output}: metric disparity, use it as --depth {output} --depth-unit 1/m")


def _guessed(
    image: Path, output: Path, model: Path, convention: str, threads: int
) -> "tuple[np.ndarray, bool]":
    """Disparity by a network, and whether it is in 1/mm."""
    from bokehnet.inference.depth_convention import find_convention
    from bokehnet.inference.monocular import DepthEstimator
    from bokehnet.io.image import read_image

    estimator = DepthEstimator(model, find_convention(convention), threads)
    _check_extension(output, estimator.metric)
    return estimator(read_image(image)), estimator.metric


def _stored(image: Path, output: Path) -> "tuple[np.ndarray, bool]":
    """Disparity inside a photo, at the photo's size, and whether it is in 1/mm."""
    from bokehnet.io.image import read_image
    from bokehnet.io.phone_depth import read_phone_depth
    from bokehnet.io.resample import resample

    found = read_phone_depth(image)
    if found is None:
        raise ParameterError(f"{image} holds no depth map; give a network with --model FILE.onnx")
    _check_extension(output, found.metric)
    picture = read_image(image) if found.all_in_focus is None else found.all_in_focus
    return resample(found.disparity, *picture.shape[:2]), found.metric


def _check_extension(output: Path, metric: bool) -> None:
    if metric and output.suffix.lower() != ".exr":
        raise ParameterError(f"--output: metric disparity needs .exr, got {output.suffix}")
