"""Make the pictures of ``docs/method/theses.md``.

Run ``python -m tools.theses_pictures [NAME ...] [--truth FOLDER]``.

Leaves before focus and lamps behind it, of the scene of ``bokehnet demo``, by each method or those named;
FOLDER holds what a lens sees, as for ``python -m tools.pictures``.
"""

import argparse
from pathlib import Path

import numpy as np

import bokehnet
from bokehnet import baselines
from bokehnet.io.maps import read_disparity
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.demo import ASSETS, BLUR, FOCUS

FOLDER = Path(__file__).parents[1] / "docs/images/theses"
QUALITY = 80

# Left, top, width, height, and which focus: the leaves above the cat; the lamps in the corner.
PLACES = {"leaves": ((250, 95, 180, 120), "middle"), "lamps": ((0, 10, 180, 120), "near")}


def write(name: str, pictures: dict[str, np.ndarray]) -> None:
    """Write both places of a method's pictures, every pixel as a square of two."""
    shown = []
    for place, ((left, top, width, height), focus) in PLACES.items():
        part = pictures[focus][top : top + height, left : left + width]
        shown.append((f"{name}, {place}", part.repeat(2, axis=0).repeat(2, axis=1)))
    bokehnet.write_image(FOLDER / f"{name}.jpg", contact_sheet([shown]), quality=QUALITY)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("methods", nargs="*", metavar="NAME", help="default: all")
    parser.add_argument("--truth", type=Path, metavar="FOLDER", help="draw the truth, too")
    arguments = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    image = bokehnet.read_image(ASSETS / "demo.png")
    disparity = read_disparity(ASSETS / "demo_disparity.png")
    defocus = {
        focus: bokehnet.defocus_from_disparity(disparity, BLUR, FOCUS[focus]) for _, focus in PLACES.values()
    }
    if arguments.truth is not None:
        shown = {focus: bokehnet.read_image(arguments.truth / f"truth_{focus}.png") for focus in defocus}
        write("truth", shown)
    for name in arguments.methods or baselines.BASELINES:
        method = getattr(baselines, name)
        write(name, {focus: method(image, blur) for focus, blur in defocus.items()})


if __name__ == "__main__":
    main()
