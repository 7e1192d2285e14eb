"""Render the pictures of ``docs/method/theses.md``.

Run ``python -m tools.pictures.theses [NAME ...] [--truth FOLDER]``.

The pictures show leaves in front of focus and lamps behind it, in the scene of ``bokehnet demo``, by each
method NAME (default: all). FOLDER contains the ray-traced references, as for :mod:`tools.pictures.overview`.
"""

import argparse
from pathlib import Path

import numpy as np

import bokehnet
from bokehnet import baselines
from bokehnet.io.maps import read_disparity
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.demo import ASSETS, BLUR, FOCUS

FOLDER = Path(__file__).parents[2] / "docs/images/theses"
QUALITY = 80

# Left, top, width, height and focus: the leaves above the cat; the lamps in the corner.
CROPS = {"leaves": ((250, 95, 180, 120), "middle"), "lamps": ((0, 10, 180, 120), "near")}


def write(name: str, pictures: dict[str, np.ndarray]) -> None:
    """Write both crops of the pictures of a method, enlarged twice by pixel repetition."""
    panels = []
    for crop, ((left, top, width, height), focus) in CROPS.items():
        part = pictures[focus][top : top + height, left : left + width]
        panels.append((f"{name}, {crop}", part.repeat(2, axis=0).repeat(2, axis=1)))
    bokehnet.write_image(FOLDER / f"{name}.jpg", contact_sheet([panels]), quality=QUALITY)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("methods", nargs="*", metavar="NAME", help="default: all")
    parser.add_argument("--truth", type=Path, metavar="FOLDER", help="also write the ray-traced reference")
    arguments = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    image = bokehnet.read_image(ASSETS / "demo.png")
    disparity = read_disparity(ASSETS / "demo_disparity.png")
    defocus = {
        focus: bokehnet.defocus_from_disparity(disparity, BLUR, FOCUS[focus]) for _, focus in CROPS.values()
    }
    if arguments.truth is not None:
        panels = {focus: bokehnet.read_image(arguments.truth / f"truth_{focus}.png") for focus in defocus}
        write("truth", panels)
    for name in arguments.methods or baselines.BASELINES:
        method = getattr(baselines, name)
        write(name, {focus: method(image, blur) for focus, blur in defocus.items()})


if __name__ == "__main__":
    main()
