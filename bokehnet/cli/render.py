"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.aperture_options import (
    ApertureImage,
    ApertureRotation,
    BladeCurvature,
    Blades,
    CatsEye,
    Obstruction,
    Rim,
    Squeeze,
    read_aperture,
)
from bokehnet.cli.engine_option import DEFAULT_ENGINE, Engine
from bokehnet.cli.focus import FocusOptions
from bokehnet.cli.light_options import Gamma, HighlightGain, HighlightThreshold, make_highlights
from bokehnet.cli.naming import named_options
from bokehnet.errors import ImageFileError

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.inference.pipeline import RenderResult

__all__ = ["render"]


def render(
    image: Annotated[Path, typer.Argument(help="All-in-focus picture; EXR and HDR are read as linear.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Where the result goes; its extension picks the format.")
    ],
    disparity: Annotated[
        Path | None, typer.Option(help="Disparity map, near is bright; normalised to 0..1.")
    ] = None,
    depth: Annotated[Path | None, typer.Option(help="EXR with metric depth in metres.")] = None,
    channel: Annotated[str | None, typer.Option(help="Channel of the map in its EXR; default: Z.")] = None,
    blur: Annotated[
        float | None, typer.Option(help="With --disparity: blur radius in pixels per unit of disparity.")
    ] = None,
    focus: Annotated[float | None, typer.Option(help="With --disparity: what stays sharp, 0..1.")] = None,
    focal_length: Annotated[float | None, typer.Option(help="With --depth: mm.")] = None,
    f_number: Annotated[float | None, typer.Option(help="With --depth: focal length over pupil.")] = None,
    focus_distance: Annotated[float | None, typer.Option(help="With --depth: metres.")] = None,
    sensor_width: Annotated[float | None, typer.Option(help="With --depth: mm.")] = None,
    focus_at: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Focus on this pixel, from the upper left.")
    ] = None,
    resize_disparity: Annotated[
        bool, typer.Option("--resize-disparity", help="Bring a map of another size to the picture's.")
    ] = False,
    refine_disparity: Annotated[
        str,
        typer.Option(
            metavar="auto|on|off",
            help="Move the map's edges to the picture's; auto: where they are out of place.",
        ),
    ] = "auto",
    engine: Engine = DEFAULT_ENGINE,
    blades: Blades = 0,
    blade_curvature: BladeCurvature = None,
    aperture_rotation: ApertureRotation = None,
    squeeze: Squeeze = 1.0,
    cats_eye: CatsEye = 0.0,
    aperture_image: ApertureImage = None,
    rim: Rim = 0.0,
    obstruction: Obstruction = 0.0,
    gamma: Gamma = 1.0,
    highlights: HighlightThreshold = None,
    highlight_gain: HighlightGain = None,
    save_maps: Annotated[
        Path | None, typer.Option(help="Folder for defocus, error map, classical and neural as pictures.")
    ] = None,
    weights: Annotated[Path | None, typer.Option(help="Folder with other networks.")] = None,
) -> None:
    """Render bokeh from an image and its depth or disparity."""
    from bokehnet.cli.progress import progress  # after parsing, so --help stays fast
    from bokehnet.inference.pipeline import BokehRenderer
    from bokehnet.io.image import check_writable, read_image, write_image

    focusing = FocusOptions(
        disparity=disparity,
        depth=depth,
        channel=channel,
        resize=resize_disparity,
        refine=refine_disparity,
        relative={"--blur": blur, "--focus": focus},
        metric={
            "--focal-length": focal_length,
            "--f-number": f_number,
            "--focus-distance": focus_distance,
            "--sensor-width": sensor_width,
        },
        focus_at=focus_at,
    )
    focusing.check()
    expansion = make_highlights(highlights, highlight_gain)
    check_writable(output)
    if save_maps is not None:
        _check_folder(save_maps)
    aperture = read_aperture(
        blades=blades,
        curvature=blade_curvature,
        rotation=aperture_rotation,
        squeeze=squeeze,
        cats_eye=cats_eye,
        image=aperture_image,
        rim=rim,
        obstruction=obstruction,
    )
    renderer = BokehRenderer(engine, aperture=aperture, weights=weights)
    picture = read_image(image)
    defocus = focusing.read_defocus(picture)
    with progress("rendering") as report, named_options({"gamma": "--gamma"}):
        result = renderer.render(picture, defocus, report, gamma=gamma, highlights=expansion)
    if save_maps is not None:
        _save_maps(save_maps, result, defocus)
    write_image(output, result.bokeh)


def _check_folder(folder: Path) -> None:
    """Raise ``ImageFileError`` unless ``folder`` is there, or could be made; nothing is touched."""
    nearest = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ImageFileError(f"--save-maps: expected a folder, found the file {nearest}")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise ImageFileError(f"--save-maps: the folder {nearest} is not writable")


def _save_maps(folder: Path, result: "RenderResult", defocus: "np.ndarray") -> None:
    """Write what the result was made of; defocus as a grey picture, 0.5 = sharp, and exact as EXR."""
    import numpy as np

    from bokehnet.io.image import write_image, write_map

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ImageFileError(f"cannot make the folder {folder}: {error.strerror}") from error
    largest = max(float(np.abs(defocus).max()), 1e-6)
    write_map(folder / "defocus.exr", defocus)
    write_map(folder / "defocus.png", 0.5 + 0.5 * defocus / largest)
    write_map(folder / "error_map.png", result.error_map)
    write_image(folder / "classical.png", result.classical)
    if result.neural is not None:
        write_image(folder / "neural.png", result.neural)
