"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.errors import ImageFileError, ParameterError

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
    engine: Annotated[str, typer.Option(help="hybrid (classical and networks) or scatter.")] = "hybrid",
    save_maps: Annotated[
        Path | None, typer.Option(help="Folder for defocus, error map, classical and neural as pictures.")
    ] = None,
    weights: Annotated[Path | None, typer.Option(help="Folder with other networks.")] = None,
) -> None:
    """Render bokeh from an image and its depth or disparity."""
    from bokehnet.checks import check_same_size  # after parsing, so --help stays fast
    from bokehnet.cli.progress import progress
    from bokehnet.inference.pipeline import BokehRenderer
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.io.maps import read_depth, read_disparity, resize_map
    from bokehnet.optics.coc import disparity_from_depth

    relative = {"--blur": blur, "--focus": focus}
    metric = {
        "--focal-length": focal_length,
        "--f-number": f_number,
        "--focus-distance": focus_distance,
        "--sensor-width": sensor_width,
    }
    _check_options(disparity, depth, relative, metric, focus_at)
    check_writable(output)
    if save_maps is not None:
        _check_folder(save_maps)
    renderer = BokehRenderer(engine, weights=weights)
    picture = read_image(image)
    height, width = picture.shape[:2]
    kind, source = ("disparity", disparity) if disparity is not None else ("depth", depth)
    assert source is not None
    if kind == "disparity":
        values = read_disparity(source, channel)
    else:  # sky at infinite depth is 0 from here on
        values = disparity_from_depth(read_depth(source, channel))
    if resize_disparity and values.shape != (height, width):
        values = resize_map(values, height, width)
    check_same_size("the picture", picture, f"its {kind}", values, "--resize-disparity brings them together")
    chosen = _value_at(focus_at, values)
    if kind == "disparity":
        assert blur is not None
        defocus = _defocus_from_disparity(values, blur, focus if chosen is None else chosen)
    else:
        defocus = _defocus_from_depth(values, metric, chosen, width)
    with progress("rendering") as report:
        result = renderer.render(picture, defocus, report)
    if save_maps is not None:
        _save_maps(save_maps, result, defocus)
    write_image(output, result.bokeh)


def _check_options(
    disparity: Path | None,
    depth: Path | None,
    relative: dict[str, float | None],
    metric: dict[str, float | None],
    focus_at: str | None,
) -> None:
    """Raise unless exactly one kind of map is given, with all of its options and none of the other's."""
    if (disparity is None) == (depth is None):
        found = "neither" if disparity is None else "both"
        raise ParameterError(f"expected one of --disparity and --depth, found {found}")
    if disparity is not None:
        mine, needed, focusing = "--disparity", ["--blur"], "--focus"
        given, other = relative, metric
    else:
        mine, needed, focusing = (
            "--depth",
            ["--focal-length", "--f-number", "--sensor-width"],
            "--focus-distance",
        )
        given, other = metric, relative
    if wrong := [name for name, value in other.items() if value is not None]:
        raise ParameterError(f"{', '.join(wrong)} cannot go with {mine}; leave it out")
    if missing := [name for name in needed if given[name] is None]:
        raise ParameterError(f"{mine} needs {', '.join(missing)}")
    if (given[focusing] is None) == (focus_at is None):
        found = "neither" if focus_at is None else "both"
        raise ParameterError(f"expected one of {focusing} and --focus-at, found {found}")


def _value_at(focus_at: str | None, values: "np.ndarray") -> float | None:
    """Value of the map at the pixel ``X,Y``."""
    if focus_at is None:
        return None
    height, width = values.shape
    try:
        x, y = (int(part) for part in focus_at.split(","))
    except ValueError as error:
        raise ParameterError(
            f"--focus-at: expected two whole numbers X,Y of a pixel, got {focus_at!r}"
        ) from error
    if not (0 <= x < width and 0 <= y < height):
        raise ParameterError(
            f"--focus-at: expected a pixel inside the picture of {width}x{height}, got {focus_at}"
        )
    return float(values[y, x])


def _defocus_from_disparity(values: "np.ndarray", blur: float, focus: float | None) -> "np.ndarray":
    import numpy as np

    from bokehnet.checks import check_at_least
    from bokehnet.optics.coc import defocus_from_disparity

    check_at_least("--blur", blur, 0)
    assert focus is not None
    if not 0 <= focus <= 1:
        raise ParameterError(f"--focus: expected a relative disparity in 0..1, got {focus:g}")
    with np.errstate(over="ignore"):  # a blur beyond float32 is told by the renderer's check
        defocus: np.ndarray = defocus_from_disparity(values, blur, focus)
    return defocus


def _defocus_from_depth(
    disparity: "np.ndarray", metric: dict[str, float | None], chosen: float | None, width: int
) -> "np.ndarray":
    """Defocus of inverse depth in 1/mm, sharp at ``chosen`` (1/mm) or at ``--focus-distance`` (metres)."""
    from bokehnet.checks import check_number
    from bokehnet.lenses import ThinLens, defocus_map

    focal_length, f_number, focus_distance, sensor_width = metric.values()
    assert focal_length is not None
    assert f_number is not None
    assert sensor_width is not None
    check_number("--sensor-width", sensor_width)
    if sensor_width <= 0:
        raise ParameterError(f"--sensor-width: expected mm above 0, got {sensor_width:g}")
    if chosen is None:
        assert focus_distance is not None
        focus = 1000 * focus_distance
    else:
        focus = 1 / chosen if chosen > 0 else math.inf
    lens = ThinLens(focal_length=focal_length, f_number=f_number, focus_distance=focus)
    defocus: np.ndarray = defocus_map(disparity, lens, sensor_width / width)
    return defocus


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
