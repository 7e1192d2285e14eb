"""``bokehnet lens fit``: the look of a lens from a photograph of lamps out of focus."""

import dataclasses
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from bokehnet.errors import ConfigError, ParameterError

__all__ = ["fit"]

_GREY = (0.2126, 0.7152, 0.0722)


def fit(
    photo: Annotated[
        Path,
        typer.Argument(help="The whole photograph, lamps out of focus, not clipped; or any, with --sharp."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Write the look here, as a .toml preset.")],
    lights: Annotated[
        str, typer.Option(help="auto, or the lamps: X,Y,RADIUS in pixels, more behind a semicolon.")
    ] = "auto",
    in_front: Annotated[
        bool, typer.Option("--in-front", help="The lamps are nearer than the focus, not behind it.")
    ] = False,
    residual: Annotated[
        Path | None, typer.Option(help="Draw the photograph, the fit and four times what is left here.")
    ] = None,
    sharp: Annotated[
        Path | None, typer.Option(help="The same view, sharp everywhere; fits blur and focus as well.")
    ] = None,
    disparity: Annotated[
        Path | None, typer.Option(help="With --sharp: its disparity, near is bright.")
    ] = None,
) -> None:
    """Fit the opening of a lens to the discs of lamps in a photograph, or to a sharp picture with depth."""
    import numpy as np

    from bokehnet.cli.progress import progress
    from bokehnet.io.atomic import check_target, write_text
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.lenses.fit.discs import find_discs
    from bokehnet.lenses.fit.fit import fit_look

    check_target(output, error=ConfigError)
    if residual is not None:
        check_writable(residual)
    if (sharp is None) != (disparity is None):
        found_one = "--sharp" if disparity is None else "--disparity"
        raise ParameterError(found_one, expected="--sharp and --disparity", shown="one of them")
    if sharp is not None and disparity is not None:
        _fit_pair(photo, sharp, disparity, output, residual)
        return
    chosen = None if lights == "auto" else _discs(lights)
    image = read_image(photo)
    discs = find_discs(image @ np.array(_GREY)) if chosen is None else chosen
    with progress("fitting", counted=False) as report:
        report(0, 1)
        found = fit_look(image, discs, behind=not in_front)
        report(1, 1)
    rows = _rows(found.look, colours=True)
    told = "".join(f"{name} = {value}\n" for name, value in rows.items())
    write_text(output, f'description = "Fitted to the lamps of a photograph"\n{told}', error=ConfigError)
    if residual is not None:
        left = np.clip(4 * np.abs(image - found.drawn), 0, 1)
        write_image(residual, np.hstack([image, found.drawn, left]))
    _tell(rows, found.deviation)
    others = ", ".join(f"{count}: {left:.4f}" for count, left in sorted(found.others.items()))
    typer.echo(f"  {len(found.discs)} discs; left of their light {found.left:.4f}; by blades {others}")


def _fit_pair(photo: Path, sharp: Path, disparity: Path, output: Path, residual: Path | None) -> None:
    """Fit blur, focus and the opening; the look goes to the file, blur and focus are told."""
    import numpy as np

    from bokehnet.cli.progress import progress
    from bokehnet.io.atomic import write_text
    from bokehnet.io.image import read_image, write_image
    from bokehnet.scene.depth.depth_source import RelativeDisparity
    from bokehnet.scene.scene import read_scene
    from bokehnet.tools.pair_fit import fit_pair

    scene = read_scene(sharp, source=RelativeDisparity(map=disparity))
    with progress("fitting", counted=False) as report:
        report(0, 1)
        found = fit_pair(scene.image, np.asarray(scene.depth.values), read_image(photo))
        report(1, 1)
    rows = _rows(found.look, colours=False)
    told = "".join(f"{name} = {value}\n" for name, value in rows.items())
    write_text(output, f'description = "Fitted to a pair of pictures"\n{told}', error=ConfigError)
    if residual is not None:
        high, wide = found.drawn.shape[:2]
        step = read_image(photo).shape[0] // high
        seen = read_image(photo)[: high * step, : wide * step].reshape(high, step, wide, step, 3).mean((1, 3))
        left = np.clip(4 * np.abs(seen - found.drawn), 0, 1) * found.taken[..., None]
        write_image(residual, np.hstack([seen, found.drawn, left]).astype(np.float32))
    _tell({"blur": found.blur, "focus": found.focus} | rows, found.deviation)
    others = ", ".join(f"{count}: {left:.4f}" for count, left in sorted(found.others.items()))
    typer.echo(f"  left of square roots of light {found.left:.4f}; by blades {others}")


# Options, what a fitted look calls them, and decimals that are written.
_OPTIONS = {
    "blades": ("blades", 0),
    "blade-curvature": ("curvature", 4),
    "aperture-rotation": ("rotation", 3),
    "rim": ("spherical_profile", 4),
    "obstruction": ("obstruction", 4),
    "cats-eye": ("cats_eye", 4),
    "axial-fringe": ("axial", 4),
    "lateral-fringe": ("lateral", 4),
}
_BLADES, _COLOURS = ("blade-curvature", "aperture-rotation"), ("axial-fringe", "lateral-fringe")


def _rows(look: Any, colours: bool) -> dict[str, float]:
    """Options of a look, by name; those of its colours where they were fitted."""
    left_out = (() if look.blades else _BLADES) + (() if colours else _COLOURS)
    return {
        option: round(getattr(look, field), decimals)
        for option, (field, decimals) in _OPTIONS.items()
        if option not in left_out
    }


def _tell(rows: dict[str, float], deviation: dict[str, float]) -> None:
    """Print each number with its doubt."""
    for name, value in rows.items():
        doubt = deviation.get(_OPTIONS[name][0] if name in _OPTIONS else name)
        typer.echo(f"  {name:<18}{value:>9.4g}" + ("" if doubt is None else f"  +- {doubt:.2g}"))


def _discs(text: str) -> list[Any]:
    from bokehnet.lenses.fit.discs import Disc

    try:
        found = []
        for part in text.split(";"):
            x, y, radius = map(float, part.split(","))
            found.append(Disc(x=x, y=y, radius=radius))
    except (TypeError, ValueError) as error:
        raise ParameterError("--lights", expected="auto, or X,Y,RADIUS;X,Y,RADIUS", got=text) from error
    for disc in found:
        if not all(map(math.isfinite, dataclasses.astuple(disc))) or disc.radius <= 0:
            raise ParameterError("--lights", expected="finite places and radii above 0", got=text)
    return found
