"""Commands of the program that read a file, by the suffix of the file."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

__all__ = ["commands", "write_partners"]

PICTURES = (
    ".png",
    ".jpg",
    ".jpeg",
    ".tif",
    ".tiff",
    ".webp",
    ".jxl",
    ".exr",
    ".hdr",
    ".pfm",
    ".heic",
    ".avif",
    ".dpx",
)
ARRAYS = (".npy", ".npz")
VIDEOS = (".mp4", ".mov", ".mkv", ".webm")
LENSES = (".zmx", ".seq", ".len", ".json", ".roa", ".csv", ".fx", ".npz", ".toml")
ARCHIVES = (".bokeh",)

_RAYS = ["--engine", "rays"]
_SCATTER = ["--engine", "scatter", "--repair-disparity", "off"]
_RELATIVE = ["--blur", "4", "--focus", "0.4", "--resize-disparity"]
_METRIC = ["--focal-length", "50", "--f-number", "2", "--sensor-width", "36", "--focus-distance", "2"]


def write_partners(folder: Path) -> int:
    """Write the intact picture, map and lens that the commands combine with the file; return exit code 0."""
    from bokehnet.io.image import write_image, write_map
    from bokehnet.lenses.catalog import find_prescription
    from bokehnet.lenses.prescription_toml import prescription_toml

    rng = np.random.default_rng(0)
    write_image(folder / "partner.png", rng.random((20, 24, 3), dtype=np.float32))
    write_map(folder / "partner_map.png", np.linspace(0, 1, 20 * 24).reshape(20, 24))
    (folder / "partner.toml").write_text(prescription_toml(find_prescription("biconvex")))
    return 0


def commands(path: Path, partners: Path) -> list[Callable[[], int]]:
    """Return the tasks that read ``path``: each runs one command line and returns its exit code.

    Args:
        path: File to read.
        partners: Folder of :func:`write_partners`; outputs are written there as well.
    """
    suffix = path.suffix.lower()
    if suffix in ARCHIVES:
        return [lambda: _reopen(path, partners)]
    lines = [[str(word) for word in words] for words in _command_lines(path, suffix, partners)]
    return [_task(words) for words in lines]


def _task(words: list[str]) -> Callable[[], int]:
    def run() -> int:
        from bokehnet.cli.app import run

        code = run(words)
        sys.stdout.flush()
        sys.stderr.flush()
        return code

    run.words = words  # type: ignore[attr-defined]
    return run


def _command_lines(path: Path, suffix: str, partners: Path) -> list[list[object]]:
    picture, depth_map, output = partners / "partner.png", partners / "partner_map.png", partners / "out.png"
    render = ["render", picture, "--disparity", depth_map, "-o", output, *_RELATIVE]
    rays = [*render, "--repair-disparity", "off", *_RAYS]
    relative = ["render", picture, "--disparity", depth_map, "-o", output, *_RELATIVE, *_SCATTER]
    if suffix in PICTURES:
        lines: list[list[object]] = [
            ["info", path],
            ["render", path, "--disparity", depth_map, "-o", output, *_RELATIVE, *_SCATTER],
            ["render", picture, "--disparity", path, "-o", output, *_RELATIVE, *_SCATTER],
        ]
        if suffix in (".exr", ".pfm", ".tif"):
            lines.append(["render", path, "--depth", path, "-o", partners / "out.exr", *_METRIC, *_SCATTER])
        else:
            lines.append(
                ["render", path, "-o", partners / "out.jpg", "--blur", "4", "--focus", "0.4", *_SCATTER]
            )
        lines.append([*relative, "--aperture-image", path])
        lines.append([*relative, "--disparity", path, "--depth-coding", "rgb24", "--invert"])
        lines.append(["render", path, *relative[2:], "--input-color-space", "logc3", "--bits", "16"])
        return lines
    if suffix in ARRAYS:
        lines = [
            ["render", picture, "--disparity", path, "-o", output, *_RELATIVE, *_SCATTER],
            ["render", picture, "--depth", path, "--depth-unit", "mm", "-o", output, *_METRIC, *_SCATTER],
        ]
        return [*lines, ["lens", path]] if suffix == ".npz" else lines
    if suffix in VIDEOS:
        return [
            ["render", path, "--disparity", path, "-o", partners / "out.mkv", *_RELATIVE, *_SCATTER],
            [
                "render",
                path,
                "--constant-disparity",
                "0.4",
                "--blur",
                "3",
                "--focus",
                "0.2",
                "-o",
                partners / "out.mp4",
                *_SCATTER,
            ],
        ]
    if suffix == ".onnx":
        return [
            ["depth", picture, "--model", path, "-o", partners / "out.exr"],
            [
                "render",
                picture,
                "--depth-model",
                path,
                "-o",
                output,
                "--blur",
                "4",
                "--focus",
                "0.4",
                *_SCATTER,
            ],
        ]
    frame = [str(name).replace(".png", ".####.png") for name in (picture, depth_map, output)]
    sequence = [
        "render",
        frame[0],
        "--frames",
        "1-2",
        "--disparity",
        frame[1],
        "-o",
        frame[2],
        *_RELATIVE,
        *_SCATTER,
    ]
    lines = []
    if suffix in LENSES:
        lines += [["lens", path], ["lens", "show", path, "--f-number", "8", "--focus", "2"]]
        lines += [["lens", "import", path, "-o", partners / "imported.toml"]]
        lines += [[*rays, "--lens", path]]
    if suffix == ".agf":
        lens = partners / "uses_glass.zmx"
        lens.write_text(ZMX)
        lines += [["lens", "import", lens, "--glasses", path]]
    if suffix in (".toml", ".csv", ".txt"):
        lines += [[*rays, "--axial-fringe", "2", "--equaliser", path]]
        lines += [
            [*relative, "--settings", path],
            [*relative, "--preset", path],
            [*rays, "--aberration-table", path],
        ]
        lines += [[*sequence, "--pull", path], ["presets", path], ["trace", path, "-o", partners / "out.exr"]]
    return lines


def _reopen(path: Path, folder: Path) -> int:
    """Read a session file of the studio; errors are printed as the command line does."""
    from bokehnet.errors import BokehnetError
    from bokehnet.studio.files.archive import read_session

    target = folder / "session"
    target.mkdir(exist_ok=True)
    try:
        read_session(path, target)
    except BokehnetError as error:
        print(f"bokehnet: error: {error}", file=sys.stderr, flush=True)  # noqa: T201
        return 1
    return 0


ZMX = """VERS 140124 258 36214
MODE SEQ
UNIT MM X W X CM MR CPMM
ENPD 10
GCAT FUZZ
FTYP 0 0 1 1 0 0 0
YFLN 5
WAVM 1 0.5876 1
PWAV 1
SURF 0
  DISZ INFINITY
SURF 1
  STOP
  CURV 0.02
  DISZ 4
  GLAS N-BK7 0 0 1.5168 64.17
  DIAM 12
SURF 2
  CURV -0.02
  DISZ 45
  DIAM 12
SURF 3
  DISZ 0
"""


def check_request_text(text: bytes) -> int:
    """Check the settings of a request to the service; errors are printed as the command line does."""
    from bokehnet.errors import BokehnetError
    from bokehnet.serve.requests import check_request

    files = {"image": "image.png", "disparity": "disparity.png"}
    try:
        check_request(text.decode("utf-8", "surrogateescape"), None, "png", files)
    except BokehnetError as error:
        print(f"bokehnet: error: {error}", file=sys.stderr, flush=True)  # noqa: T201
        return 1
    return 0
