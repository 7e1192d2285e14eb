"""Render the pictures of ``docs/method/overview.md`` and ``docs/use/shapes.md``.

Run ``python -m tools.pictures.overview TRUTH``.

All pictures show the scene of ``bokehnet demo``, most of them rendered by ``bokehnet render``. TRUTH is the
folder of the ray-traced references of ``python examples/demo_scene.py --out FOLDER --truth TRUTH`` (FOLDER
must not be the assets of the package).
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
from train.data.degradation import degrade

IMAGES = Path(__file__).parents[2] / "docs/images"
PICTURE, DISPARITY = ASSETS / "demo.png", ASSETS / "demo_disparity.png"
QUALITY = 85

# Left, top, width, height: the leaves above the cat, the lamps in the corner, the left half of the branch.
LEAVES = (250, 95, 180, 120)
LAMPS = (0, 10, 240, 160)
BRANCH = (240, 0, 480, 260)

Crop = tuple[int, int, int, int]


def render(disparity: Path, focus: str, *options: str, maps: Path | None = None) -> np.ndarray:
    """Return the demo rendered by ``bokehnet render``, scene-linear, (H, W, 3)."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "out.png"
        words = ["render", str(PICTURE), "--disparity", str(disparity), "-o", str(output)]
        words += ["--blur", str(BLUR), "--focus", str(FOCUS[focus]), *options]
        if maps is not None:
            words += ["--save-maps", str(maps)]
        if run(words) != 0:
            raise SystemExit("bokehnet render failed")
        return bokehnet.read_image(output)


def enlarged(picture: np.ndarray, crop: Crop, factor: int = 2) -> np.ndarray:
    """Return a crop of a picture, enlarged by pixel repetition."""
    left, top, width, height = crop
    part = picture[top : top + height, left : left + width]
    return part.repeat(factor, axis=0).repeat(factor, axis=1)


def grey(values: np.ndarray) -> np.ndarray:
    """Return a map (H, W) in [0, 1] as a scene-linear picture whose sRGB values equal the map."""
    return srgb_to_linear(values)[..., None].repeat(3, axis=-1)


def write(name: str, rows: list[list[tuple[str, np.ndarray]]]) -> None:
    """Write a contact sheet to the folder of images."""
    bokehnet.write_image(IMAGES / name, contact_sheet(rows), quality=QUALITY)


def show_maps(image: np.ndarray, disparity: np.ndarray) -> None:
    """Write the inputs and the intermediate maps of a render."""
    with tempfile.TemporaryDirectory() as folder:
        render(DISPARITY, "middle", maps=Path(folder))
        defocus, error_map = (
            bokehnet.read_image(Path(folder) / f"{name}.png") for name in ("defocus", "error_map")
        )
    maps_at_half_size = [x[::2, ::2] for x in (image, grey(disparity), defocus, error_map)]
    names = ("picture", "disparity", "defocus, grey is sharp", "error map")
    pictures = list(zip(names, maps_at_half_size, strict=True))
    write("method_maps.jpg", [pictures[:2], pictures[2:]])


def show_engines(image: np.ndarray, truth: Path) -> None:
    """Write the leaves in front of the cat, by each engine and ray traced."""
    pictures = [
        (name, render(DISPARITY, "middle", "--engine", name)) for name in ("scatter", "rays", "hybrid")
    ]
    pictures = [
        ("picture", image),
        ("ray traced", bokehnet.read_image(truth / "truth_middle.png")),
        *pictures,
    ]
    pictures = [(name, enlarged(picture, LEAVES)) for name, picture in pictures]
    write("method_engines.jpg", [pictures[:2], pictures[2:]])


def show_outlines(truth: Path) -> None:
    """Write leaves far in front of focus, by the scatter engines, by rays and ray traced."""
    names = ("scatter", "fast", "neural", "rays")
    pictures = [(name, render(DISPARITY, "far", "--engine", name)) for name in names]
    pictures = [*pictures, ("ray traced", bokehnet.read_image(truth / "truth_far.png"))]
    pictures = [(name, enlarged(picture, BRANCH, factor=1)) for name, picture in pictures]
    write("method_outlines.jpg", [pictures[:3], pictures[3:]])


def show_hidden(image: np.ndarray, disparity: np.ndarray) -> None:
    """Write the picture and its occluded background."""
    defocus = bokehnet.defocus_from_disparity(disparity, BLUR, FOCUS["middle"])
    background, _ = bokehnet.occluded_background(image, defocus)
    pictures = [("picture", image), ("occluded background", background)]
    write("method_hidden.jpg", [[(name, enlarged(picture, BRANCH, factor=1)) for name, picture in pictures]])


def show_repair() -> None:
    """Write renders with an accurate map, an eroded map, and the repaired eroded map."""
    with tempfile.TemporaryDirectory() as folder:
        eroded_path = Path(folder) / "wrong.exr"
        bokehnet.write_image(eroded_path, _eroded())
        pictures = [
            ("right map", render(DISPARITY, "middle")),
            ("near things shrunk by 2 px", render(eroded_path, "middle", "--repair-disparity", "off")),
            ("repaired", render(eroded_path, "middle", "--repair-disparity", "on")),
        ]
    write("method_repair.jpg", [[(name, enlarged(picture, LEAVES)) for name, picture in pictures]])


def _eroded() -> np.ndarray:
    return degrade(read_disparity(DISPARITY), "eroded")[..., None].repeat(3, axis=-1)


def show_shapes() -> None:
    """Write lamps with several aperture shapes."""
    highlights = ("--highlights", "0.5")
    options = {
        "disc": (),
        "disc, --highlights 0.5": highlights,
        "--blades 6": (*highlights, "--blades", "6"),
        "--squeeze 0.5": (*highlights, "--squeeze", "0.5"),
        "--cats-eye 1": (*highlights, "--cats-eye", "1"),
        "--rim 1": (*highlights, "--rim", "1"),
    }
    pictures = [
        (name, enlarged(render(DISPARITY, "near", *words), LAMPS, factor=1))
        for name, words in options.items()
    ]
    write("shapes.jpg", [pictures[:3], pictures[3:]])


def main() -> None:
    """Run the command line."""
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
