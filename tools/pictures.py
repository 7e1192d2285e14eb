"""Make the pictures of ``docs/method/overview.md`` and ``docs/use/shapes.md``.

Run ``python -m tools.pictures TRUTH``.

All show the scene of ``bokehnet demo``, most of them as ``bokehnet render`` writes it. TRUTH holds what a
lens sees of it, ray traced by ``python examples/demo_scene.py --out FOLDER --truth TRUTH`` (FOLDER: not
the package's own assets).
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import bokehnet
from bokehnet.cli.app import run
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.maps import read_disparity
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.demo import ASSETS, BLUR, FOCUS
from train.degradation import degrade

IMAGES = Path(__file__).parents[1] / "docs/images"
PICTURE, DISPARITY = ASSETS / "demo.png", ASSETS / "demo_disparity.png"
QUALITY = 85

# Left, top, width, height: the leaves above the cat, the lamps in the corner, the left half of the branch.
LEAVES = (250, 95, 180, 120)
LAMPS = (0, 10, 240, 160)
BRANCH = (240, 0, 480, 260)

Place = tuple[int, int, int, int]


def render(disparity: Path, focus: str, *options: str, maps: Path | None = None) -> np.ndarray:
    """Return what ``bokehnet render`` makes of the demo, scene-linear, (H, W, 3)."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "out.png"
        words = ["render", str(PICTURE), "--disparity", str(disparity), "-o", str(output)]
        words += ["--blur", str(BLUR), "--focus", str(FOCUS[focus]), *options]
        if maps is not None:
            words += ["--save-maps", str(maps)]
        if run(words) != 0:
            raise SystemExit("bokehnet render failed")
        return bokehnet.read_image(output)


def enlarged(picture: np.ndarray, place: Place, factor: int = 2) -> np.ndarray:
    """A part of a picture with every pixel as a square."""
    left, top, width, height = place
    part = picture[top : top + height, left : left + width]
    return part.repeat(factor, axis=0).repeat(factor, axis=1)


def grey(values: np.ndarray) -> np.ndarray:
    """A map (H, W) in [0, 1] as a picture whose sRGB values are the map's."""
    return srgb_to_linear(values)[..., None].repeat(3, axis=-1)


def write(name: str, rows: list[list[tuple[str, np.ndarray]]]) -> None:
    """Write a sheet beside this file."""
    bokehnet.write_image(IMAGES / name, contact_sheet(rows), quality=QUALITY)


def show_maps(image: np.ndarray, disparity: np.ndarray) -> None:
    """What goes in and what is made of it on the way."""
    with tempfile.TemporaryDirectory() as folder:
        render(DISPARITY, "middle", maps=Path(folder))
        defocus, error_map = (
            bokehnet.read_image(Path(folder) / f"{name}.png") for name in ("defocus", "error_map")
        )
    half = [x[::2, ::2] for x in (image, grey(disparity), defocus, error_map)]
    names = ("picture", "disparity", "defocus, grey is sharp", "error map")
    shown = list(zip(names, half, strict=True))
    write("method_maps.jpg", [shown[:2], shown[2:]])


def show_engines(image: np.ndarray, truth: Path) -> None:
    """The same leaves before the cat: by each engine, and as a lens sees them."""
    shown = [(name, render(DISPARITY, "middle", "--engine", name)) for name in ("scatter", "rays", "hybrid")]
    shown = [("picture", image), ("ray traced", bokehnet.read_image(truth / "truth_middle.png")), *shown]
    shown = [(name, enlarged(picture, LEAVES)) for name, picture in shown]
    write("method_engines.jpg", [shown[:2], shown[2:]])


def show_outlines(truth: Path) -> None:
    """Leaves far before focus: by the engines on the scatter, by rays, and as a lens sees them."""
    names = ("scatter", "fast", "neural", "rays")
    shown = [(name, render(DISPARITY, "far", "--engine", name)) for name in names]
    shown = [*shown, ("ray traced", bokehnet.read_image(truth / "truth_far.png"))]
    shown = [(name, enlarged(picture, BRANCH, factor=1)) for name, picture in shown]
    write("method_outlines.jpg", [shown[:3], shown[3:]])


def show_hidden(image: np.ndarray, disparity: np.ndarray) -> None:
    """The picture, and what is taken to stand behind it."""
    defocus = bokehnet.defocus_from_disparity(disparity, BLUR, FOCUS["middle"])
    hidden, _ = bokehnet.occluded_background(image, defocus)
    shown = [("picture", image), ("occluded background", hidden)]
    write("method_hidden.jpg", [[(name, enlarged(picture, BRANCH, factor=1)) for name, picture in shown]])


def show_repair() -> None:
    """A map whose near things have shrunk, as it is and repaired."""
    with tempfile.TemporaryDirectory() as folder:
        wrong = Path(folder) / "wrong.exr"
        bokehnet.write_image(wrong, _eroded())
        shown = [
            ("right map", render(DISPARITY, "middle")),
            ("near things shrunk by 2 px", render(wrong, "middle", "--repair-disparity", "off")),
            ("repaired", render(wrong, "middle", "--repair-disparity", "on")),
        ]
    write("method_repair.jpg", [[(name, enlarged(picture, LEAVES)) for name, picture in shown]])


def _eroded() -> np.ndarray:
    return degrade(read_disparity(DISPARITY), "eroded")[..., None].repeat(3, axis=-1)


def show_shapes() -> None:
    """Lamps through other openings."""
    lit = ("--highlights", "0.5")
    options = {
        "disc": (),
        "disc, --highlights 0.5": lit,
        "--blades 6": (*lit, "--blades", "6"),
        "--squeeze 0.5": (*lit, "--squeeze", "0.5"),
        "--cats-eye 1": (*lit, "--cats-eye", "1"),
        "--rim 1": (*lit, "--rim", "1"),
    }
    shown = [
        (name, enlarged(render(DISPARITY, "near", *words), LAMPS, factor=1))
        for name, words in options.items()
    ]
    write("shapes.jpg", [shown[:3], shown[3:]])


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("truth", type=Path, metavar="TRUTH")
    truth = parser.parse_args().truth
    image, disparity = bokehnet.read_image(PICTURE), read_disparity(DISPARITY)
    show_maps(image, disparity)
    show_engines(image, truth)
    show_outlines(truth)
    show_hidden(image, disparity)
    show_repair()
    show_shapes()


if __name__ == "__main__":
    main()
