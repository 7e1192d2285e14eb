"""Render the pictures of ``docs/use/looks.md``.

Run ``python -m tools.pictures.looks PHOTO DISPARITY BLUR FOCUS``.

The sheets show every preset on a photograph (PHOTO with its DISPARITY, rendered with BLUR and FOCUS) and on
the street of ``examples/night_scene.py``, and each effect alone on that street, as rendered by ``bokehnet
render``.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import bokehnet
from bokehnet.cli.app import run
from bokehnet.settings.preset import presets as preset_names
from bokehnet.tools.contact_sheet import contact_sheet
from examples.night_scene import FOCUS, night_scene

IMAGES = Path(__file__).parents[2] / "docs/images"
QUALITY = 85
NIGHT_BLUR = 60
COLUMNS = 3

# Stronger than in a good lens, so that the effects are clearly visible.
EFFECTS = {
    "none": (),
    "--cats-eye 1.2": ("--cats-eye", "1.2"),
    "--rim 1": ("--rim", "1"),
    "--onion 0.6": ("--onion", "0.6"),
    "--disc-grain 0.4": ("--disc-grain", "0.4"),
    "--spherical 2": ("--spherical", "2"),
    "--coma 4": ("--coma", "4"),
    "--astigmatism 3": ("--astigmatism", "3"),
    "--field-curvature 4": ("--field-curvature", "4"),
    "--axial-fringe 1.5": ("--axial-fringe", "1.5"),
    "--lateral-fringe 2": ("--lateral-fringe", "2"),
    "--distortion -0.1": ("--distortion", "-0.1"),
    "--vignette 2": ("--vignette", "2"),
    "--grain 6400": ("--grain", "6400"),
    "--lens petzval": ("--lens", "petzval"),
}


def render(picture: Path, disparity: Path, blur: float, focus: float, *options: str) -> np.ndarray:
    """Return a picture rendered by ``bokehnet render``, scene-linear, (H, W, 3)."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "out.png"
        words = ["render", str(picture), "--disparity", str(disparity), "-o", str(output), *options]
        if run([*words, "--blur", str(blur), "--focus", str(focus), "--repair-disparity", "off"]) != 0:
            raise SystemExit("bokehnet render failed")
        return bokehnet.read_image(output)


def halved(picture: np.ndarray) -> np.ndarray:
    """Return the picture at half the size: means of 2x2 pixels."""
    height, width = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
    even = picture[:height, :width].reshape(height // 2, 2, width // 2, 2, 3)
    return np.asarray(even.mean(axis=(1, 3)))


def write(name: str, pictures: dict[str, np.ndarray]) -> None:
    """Write a contact sheet to the folder of images."""
    pairs = list(pictures.items())
    rows = [pairs[i : i + COLUMNS] for i in range(0, len(pairs), COLUMNS)]
    bokehnet.write_image(IMAGES / name, contact_sheet(rows), quality=QUALITY)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photo", type=Path)
    parser.add_argument("disparity", type=Path)
    parser.add_argument("blur", type=float)
    parser.add_argument("focus", type=float)
    arguments = parser.parse_args()
    looks = {"no preset": ()} | {name: ("--preset", name) for name in preset_names()}
    photo = (arguments.photo, arguments.disparity, arguments.blur, arguments.focus)
    write("looks_photo.jpg", {name: halved(render(*photo, *words)) for name, words in looks.items()})
    with tempfile.TemporaryDirectory() as folder:
        street, disparity = Path(folder) / "night.exr", Path(folder) / "disparity.exr"
        picture, depth = night_scene()
        bokehnet.write_image(street, picture)
        bokehnet.write_image(disparity, np.repeat(depth[..., None], 3, axis=-1))
        night = (street, disparity, NIGHT_BLUR, FOCUS)
        write("looks_night.jpg", {name: halved(render(*night, *words)) for name, words in looks.items()})
        write("looks_alone.jpg", {name: halved(render(*night, *words)) for name, words in EFFECTS.items()})


if __name__ == "__main__":
    main()
