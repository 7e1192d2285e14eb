"""Contact sheets of photographs by blur and focus: ``python -m benchmarks.quality.photographs FOLDER``.

FOLDER holds photographs ``NAME.jpg`` with disparity ``NAME.png``. One sheet per photograph shows blur by
focus; with ``--crop X,Y,SIZE`` it shows square crops rendered by several engines.
"""

import argparse
from pathlib import Path

import numpy as np

from bokehnet.arrays.pyramid import downsample2
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.render.renderer import BokehRenderer
from bokehnet.tools.contact_sheet import contact_sheet

BLURS = (30.0, 60.0, 120.0)

# Focus: name on the sheet -> quantile of the disparity.
FOCUS = {"far": 0.1, "middle": 0.5, "near": 0.95}


def _halved(picture: np.ndarray) -> np.ndarray:
    even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
    return np.ascontiguousarray(downsample2(even.transpose(2, 0, 1)).transpose(1, 2, 0))


def blur_by_focus(image: np.ndarray, disparity: np.ndarray, renderer: BokehRenderer) -> np.ndarray:
    """Return a sheet of all blurs (rows) and focus distances (columns), at a quarter of the size."""
    rows = []
    for blur in BLURS:
        row = []
        for name, quantile in FOCUS.items():
            defocus = defocus_from_disparity(disparity, blur, float(np.quantile(disparity, quantile)))
            bokeh = renderer.render_arrays(image, defocus).bokeh
            row.append((f"blur {blur:g}, focus {name}", _halved(_halved(bokeh))))
        rows.append(row)
    return contact_sheet(rows)


def crops(
    image: np.ndarray,
    renders: dict[str, np.ndarray],
    squares: list[tuple[int, int, int]],
) -> np.ndarray:
    """Return a sheet with one row per square (left, top, size): the photograph, then each render."""
    pictures = {"photograph": image, **renders}
    rows = []
    for x, y, size in squares:
        rows.append([(name, picture[y : y + size, x : x + size]) for name, picture in pictures.items()])
    return contact_sheet(rows)


def _parse_square(text: str) -> tuple[int, int, int]:
    x, y, size = (int(part) for part in text.split(","))
    return x, y, size


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("."))
    parser.add_argument("--engine", default="hybrid")
    parser.add_argument("--only", action="append", help="name of a photograph; default: all")
    parser.add_argument("--crop", action="append", type=_parse_square, metavar="X,Y,SIZE", help="with --only")
    parser.add_argument("--blur", type=float, default=60.0, help="for the crops")
    parser.add_argument("--focus", type=float, default=90 / 255, help="for the crops")
    parser.add_argument("--rival", type=Path, help="another render of the photograph to show with the crops")
    arguments = parser.parse_args()
    renderer, repair = BokehRenderer(arguments.engine), DisparityRepair()
    for path in sorted(arguments.folder.glob("*.jpg")):
        if arguments.only and path.stem not in arguments.only:
            continue
        image, disparity = read_image(path), read_disparity(path.with_suffix(".png"))
        repaired = repair(image, disparity, "auto")
        if not arguments.crop:
            write_image(
                arguments.out / f"photograph_{path.stem}.jpg", blur_by_focus(image, repaired, renderer)
            )
            continue
        maps = {"as it is": disparity, "repaired": repaired}
        variants = [("scatter", "as it is"), ("rays", "as it is"), ("rays", "repaired")]
        if arguments.engine not in ("scatter", "rays"):
            variants.append((arguments.engine, "repaired"))
        renders = {}
        for engine, kind in variants:
            defocus = defocus_from_disparity(maps[kind], arguments.blur, arguments.focus)
            name = engine if kind == "as it is" else f"{engine}, repaired"
            renders[name] = BokehRenderer(engine).render_arrays(image, defocus).bokeh
        if arguments.rival is not None:
            renders[arguments.rival.stem] = read_image(arguments.rival)
        write_image(arguments.out / f"crops_{path.stem}.jpg", crops(image, renders, arguments.crop))


if __name__ == "__main__":
    main()
