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
    photo: Annotated[Path, typer.Argument(help="The whole photograph, lamps out of focus, not clipped.")],
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
) -> None:
    """Fit the opening and the colours of a lens to the discs of lamps in a photograph."""
    import numpy as np

    from bokehnet.cli.progress import progress
    from bokehnet.io.atomic import check_target, write_text
    from bokehnet.io.image import check_writable, read_image, write_image
    from bokehnet.lenses.look_fit.discs import find_discs
    from bokehnet.lenses.look_fit.fit import fit_look

    check_target(output, error=ConfigError)
    if residual is not None:
        check_writable(residual)
    chosen = None if lights == "auto" else _discs(lights)
    image = read_image(photo)
    discs = find_discs(image @ np.array(_GREY)) if chosen is None else chosen
    with progress("fitting", counted=False) as report:
        report(0, 1)
        found = fit_look(image, discs, behind=not in_front)
        report(1, 1)
    look = found.look
    rows = {
        "blades": look.blades,
        "blade-curvature": round(look.curvature, 4),
        "aperture-rotation": round(look.rotation, 3),
        "rim": round(look.spherical_profile, 4),
        "obstruction": round(look.obstruction, 4),
        "cats-eye": round(look.cats_eye, 4),
        "axial-fringe": round(look.axial, 4),
        "lateral-fringe": round(look.lateral, 4),
    }
    if not look.blades:
        del rows["blade-curvature"], rows["aperture-rotation"]
    told = "".join(f"{name} = {value}\n" for name, value in rows.items())
    write_text(output, f'description = "Fitted to the lamps of a photograph"\n{told}', error=ConfigError)
    if residual is not None:
        left = np.clip(4 * np.abs(image - found.drawn), 0, 1)
        write_image(residual, np.hstack([image, found.drawn, left]))
    names = {"curvature": "blade-curvature", "rotation": "aperture-rotation", "spherical_profile": "rim"}
    spread = {names.get(name, name): value for name, value in found.deviation.items()}
    for name, value in rows.items():
        key = name.replace("-fringe", "").replace("-", "_") if name not in spread else name
        doubt = spread.get(key)
        typer.echo(f"  {name:<18}{value:>9.4g}" + ("" if doubt is None else f"  +- {doubt:.2g}"))
    others = ", ".join(f"{count}: {left:.4f}" for count, left in sorted(found.others.items()))
    typer.echo(f"  {len(found.discs)} discs; left of their light {found.left:.4f}; by blades {others}")


def _discs(text: str) -> list[Any]:
    from bokehnet.lenses.look_fit.discs import Disc

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
