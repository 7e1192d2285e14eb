"""Render the pictures of ``docs/method/clipped_light.md``: ``python -m tools.pictures.clipped_light``.

Own traced scenes, stored in 8 bits with a hard clip, rendered by ``bokehnet render`` with and without
recovered light, and the truth. Then recovered lamps with onion rings and cat's-eye.
"""

import tempfile
from pathlib import Path

import numpy as np

import bokehnet
from bokehnet.cli.app import run
from tools.pictures.overview import enlarged, write
from train.data import light_scenes
from train.data.light_scenes import CAMERAS, LightCase, decoded

# Kind and seed of the scenes; no constant was chosen on these seeds.
SCENES = (("night", 201), ("sky", 203), ("window", 202))

LOOKS = {
    "default": (),
    "--onion 1": ("--onion", "1"),
    "--cats-eye 1": ("--cats-eye", "1"),
}
_CROP = (0, 0, 192, 128)


def render(case: LightCase, *options: str) -> np.ndarray:
    """Return the stored picture of a case rendered by ``bokehnet render``, scene-linear, (H, W, 3)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bokehnet.write_image(folder / "photo.png", _stored(case))
        np.save(folder / "map.npy", case.disparity)
        words = ["render", str(folder / "photo.png"), "--disparity", str(folder / "map.npy"), "-q"]
        words += ["--blur", str(case.blur), "--focus", str(case.focus), "--disparity-range", "0,1"]
        if run([*words, *options, "-o", str(folder / "out.png")]) != 0:
            raise SystemExit("bokehnet render failed")
        return bokehnet.read_image(folder / "out.png")


def row(case: LightCase) -> list[tuple[str, np.ndarray]]:
    """Return the stored picture, its renders and the truth, with titles."""
    return [
        ("stored in 8 bits", _stored(case)),
        ("--highlights off", render(case, "--highlights", "off")),
        ("default", render(case)),
        ("ray traced", case.truth.clip(0, 1)),
    ]


def _stored(case: LightCase) -> np.ndarray:
    return decoded(CAMERAS["hard"].store(case.image))


def main() -> None:
    """Write the pictures."""
    cases = [light_scenes.make_case(kind, seed) for kind, seed in SCENES]
    write("clipped_light.jpg", [row(case) for case in cases])
    looks = [(name, enlarged(render(cases[0], *words), _CROP)) for name, words in LOOKS.items()]
    write("clipped_light_looks.jpg", [looks])


if __name__ == "__main__":
    main()
