"""``bokehnet lens fit``: the look of a lens, fitted to a photo of defocused lights."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import click

from bokehnet.cli.parser import PATH, SectionedCommand, argument
from bokehnet.errors import ConfigError, ParameterError

__all__ = ["fit"]

_GREY = (0.2126, 0.7152, 0.0722)


@click.command(cls=SectionedCommand)
@argument(
    "photo", type=PATH, help="Uncropped photo with defocused, unclipped lights; with --sharp: any photo."
)
@click.option("--output", "-o", type=PATH, required=True, help="Output file of the preset, .toml.")
@click.option(
    "--lights",
    default="auto",
    help="Discs to fit: auto (default), or X,Y,RADIUS in pixels, separated by semicolons.",
)
@click.option("--in-front", is_flag=True, help="The lights are in front of focus instead of behind it.")
@click.option("--residual", type=PATH, help="Output image: photo, fit, and 4 times their difference.")
@click.option("--sharp", type=PATH, help="All-in-focus picture of the same view; also fits blur and focus.")
@click.option("--disparity", type=PATH, help="With --sharp: its disparity map; bright is near.")
def fit(
    photo: Path,
    output: Path,
    lights: str,
    in_front: bool,
    residual: Path | None,
    sharp: Path | None,
    disparity: Path | None,
) -> None:
    """Fit aperture and fringes of a lens to pictures.

    The pictures: a photo of defocused lights, or a pair with and without blur.
    """
    import numpy as np

    from bokehnet.cli.progress import progress
    from bokehnet.io.files.atomic import check_target, write_text
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.lenses.fit.discs import find_discs
    from bokehnet.lenses.fit.fit import fit_look

    check_target(output, error=ConfigError)
    if residual is not None:
        check_writable(residual)
    if (sharp is None) != (disparity is None):
        present = "--sharp" if disparity is None else "--disparity"
        raise ParameterError(present, expected="--sharp and --disparity", shown="one of them")
    if sharp is not None and disparity is not None:
        _fit_pair(photo, sharp, disparity, output, residual)
        return
    listed = None if lights == "auto" else _discs(lights)
    image = read_image(photo)
    discs = find_discs(image @ np.array(_GREY)) if listed is None else listed
    with progress("fitting", counted=False) as report:
        report(0, 1)
        fitted = fit_look(image, discs, behind=not in_front)
        report(1, 1)
    rows = _rows(fitted.look, colours=True)
    lines = "".join(f"{name} = {value}\n" for name, value in rows.items())
    write_text(output, f'description = "Fitted to the lights of a photo"\n{lines}', error=ConfigError)
    if residual is not None:
        difference = np.clip(4 * np.abs(image - fitted.rendered), 0, 1)
        write_image(residual, np.hstack([image, fitted.rendered, difference]))
    _print_values(rows, fitted.deviation)
    others = ", ".join(f"{count}: {value:.4f}" for count, value in sorted(fitted.residual_by_blades.items()))
    click.echo(f"  {len(fitted.discs)} discs; residual light {fitted.residual:.4f}; by blades {others}")


def _fit_pair(photo: Path, sharp: Path, disparity: Path, output: Path, residual: Path | None) -> None:
    """Fit blur, focus and aperture; write the look to the file and print blur and focus."""
    import numpy as np

    from bokehnet.cli.progress import progress
    from bokehnet.io.files.atomic import write_text
    from bokehnet.io.image import read_image, write_image
    from bokehnet.scene.depth.depth_source import RelativeDisparity
    from bokehnet.scene.scene import read_scene
    from bokehnet.tools.pair_fit import fit_pair

    scene = read_scene(sharp, source=RelativeDisparity(map=disparity))
    with progress("fitting", counted=False) as report:
        report(0, 1)
        fitted = fit_pair(scene.image, np.asarray(scene.depth.values), read_image(photo))
        report(1, 1)
    rows = _rows(fitted.look, colours=False)
    lines = "".join(f"{name} = {value}\n" for name, value in rows.items())
    write_text(output, f'description = "Fitted to a pair of pictures"\n{lines}', error=ConfigError)
    if residual is not None:
        height, width = fitted.rendered.shape[:2]
        step = read_image(photo).shape[0] // height
        cropped = read_image(photo)[: height * step, : width * step]
        reduced = cropped.reshape(height, step, width, step, 3).mean((1, 3))
        difference = np.clip(4 * np.abs(reduced - fitted.rendered), 0, 1) * fitted.mask[..., None]
        write_image(residual, np.hstack([reduced, fitted.rendered, difference]).astype(np.float32))
    _print_values({"blur": fitted.blur, "focus": fitted.focus} | rows, fitted.deviation)
    others = ", ".join(f"{count}: {value:.4f}" for count, value in sorted(fitted.residuals.items()))
    click.echo(f"  residual of square roots of light {fitted.residual:.4f}; by blades {others}")


# Option, field of a fitted look, and number of decimals to write.
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
    """Return the options of a look by name; those of fringes only if ``colours``."""
    excluded = (() if look.blades else _BLADES) + (() if colours else _COLOURS)
    return {
        option: round(getattr(look, field), decimals)
        for option, (field, decimals) in _OPTIONS.items()
        if option not in excluded
    }


def _print_values(rows: dict[str, float], deviation: dict[str, float]) -> None:
    """Print each value with its standard deviation."""
    for name, value in rows.items():
        sigma = deviation.get(_OPTIONS[name][0] if name in _OPTIONS else name)
        click.echo(f"  {name:<18}{value:>9.4g}" + ("" if sigma is None else f"  +- {sigma:.2g}"))


def _discs(text: str) -> list[Any]:
    from bokehnet.lenses.fit.discs import Disc

    try:
        discs = []
        for part in text.split(";"):
            x, y, radius = map(float, part.split(","))
            discs.append(Disc(x=x, y=y, radius=radius))
    except (TypeError, ValueError) as error:
        raise ParameterError("--lights", expected="auto, or X,Y,RADIUS;X,Y,RADIUS", got=text) from error
    for disc in discs:
        if not all(map(math.isfinite, dataclasses.astuple(disc))) or disc.radius <= 0:
            raise ParameterError("--lights", expected="finite positions and radii above 0", got=text)
    return discs
