"""Golden set: outputs of the command line that must not change when the code is refactored.

    git worktree add ../before REVISION
    PYTHONPATH=../before python benchmarks/golden.py write golden/before
    PYTHONPATH=.         python benchmarks/golden.py write golden/now
    python benchmarks/golden.py compare golden/before golden/now

``write`` runs some forty command lines and four exports with the imported bokehnet; the inputs are made here,
from the demo picture and from numbers, by libraries that are not under test. ``compare`` requires that files
of 8 and 16 bits are equal byte for byte and that floating-point pictures are equal or differ by at most -120
dB.
"""

import base64
import math
import shutil
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813

_ROOT = Path(__file__).resolve().parents[1]
_MIN_PSNR_DB = 120.0  # between floating-point pictures

_PHOTO = ("photo.png", "--disparity", "disparity.png")
_BASE = (*_PHOTO, "--blur", "24", "--focus", "0.46")
_LARGE = ("large.png", "--disparity", "large_disparity.png", "--blur", "24", "--focus", "0.46")
_LENS = ("--focal-length", "50", "--f-number", "1.8", "--sensor-width", "36")
_DEPTH = ("shot.exr", "--depth", "shot.exr", *_LENS, "--focus-distance", "2.5")

# Name of the case -> arguments of "bokehnet render".
RENDERS: dict[str, tuple[str, ...]] = {
    "rays": (*_BASE, "-o", "out.png"),
    "rays_tiff": (*_BASE, "-o", "out.tif"),
    "rays_linear": (*_BASE, "-o", "out.exr"),
    "scatter": (*_BASE, "--engine", "scatter", "-o", "out.exr"),
    "scatter_gamma": (*_BASE, "--engine", "scatter", "--gamma", "2", "-o", "out.png"),
    "fast": (*_BASE, "--engine", "fast", "-o", "out.exr"),
    "hybrid": (*_BASE, "--engine", "hybrid", "-o", "out.exr", "--save-maps", "maps"),
    "refine_on": (*_BASE, "--refine-disparity", "on", "-o", "out.exr"),
    "refine_off": (*_BASE, "--refine-disparity", "off", "-o", "out.png"),
    "blades": (
        *(*_BASE, "-o", "out.png", "--blades", "6", "--blade-curvature", "0.4"),
        *("--aperture-rotation", "12", "--cats-eye", "0.6", "--highlights", "0.8", "--highlight-gain", "6"),
    ),
    "aperture_image": (*_BASE, "-o", "out.png", "--aperture-image", "star.png", "--aperture-rotation", "20"),
    "disc_texture": (
        *(*_BASE, "--engine", "scatter", "-o", "out.png", "--rim", "0.5", "--obstruction", "0.3"),
        *("--onion", "0.4", "--onion-rings", "8", "--disc-grain", "0.3", "--disc-grain-seed", "3"),
    ),
    "squeeze": (*_BASE, "--squeeze", "0.6", "--rim", "-0.4", "-o", "out.png"),
    "preset_anamorphic": (*_BASE, "--preset", "anamorphic", "-o", "out.exr"),
    "preset_swirl": (*_BASE, "--preset", "petzval-swirl", "-o", "out.png"),
    "preset_night": (*_BASE, "--preset", "night-cinema", "--blades", "5", "-o", "out.png"),
    "preset_singlet": (*_BASE, "--preset", "vintage-singlet", "-o", "out.png"),
    "preset_phone": (*_BASE, "--preset", "smartphone", "-o", "out.png"),
    "lens": (*_BASE, "--lens", "double_gauss", "--lens-f-number", "2.4", "-o", "out.png"),
    "lens_metric": (
        *_DEPTH,
        "--lens",
        "petzval",
        "--lens-f-number",
        "2.8",
        "--aberrations",
        "seidel",
        "--lens-distortion",
        "-o",
        "out.exr",
    ),
    "fringes": (
        *(
            *_BASE,
            "-o",
            "out.png",
            "--axial-fringe",
            "0.4",
            "--lateral-fringe",
            "0.2",
            "--axial-map",
            "square",
        ),
        *("--fringe-glass", "achromat", "--equaliser", "1,1,0,0,3,1,1"),
    ),
    "sliders": (*_BASE, "--spherical", "0.5", "--coma", "0.8", "--astigmatism", "0.6", "-o", "out.png"),
    "tilt": (
        *_BASE[:3],
        "--blur",
        "24",
        "--focus-at",
        "200,150",
        "--tilt-x",
        "40",
        "--tilt-y",
        "-10",
        "-o",
        "out.png",
    ),
    "focus_plane": (
        *_BASE[:3],
        "--blur",
        "24",
        "--focus-plane",
        "20,200",
        "300,210",
        "180,90",
        "-o",
        "out.png",
    ),
    "focus_range": (*_BASE[:3], "--blur", "24", "--focus-range", "0.3,0.6", "-o", "out.png"),
    "effects": (
        *(*_BASE, "-o", "out.png", "--distortion-brown", "-0.08,0.02", "--vignette", "0.8", "--cos4", "30"),
        *("--vignette-radius", "0.4", "--grain", "1600", "--grain-size", "1.5", "--grain-seed", "7"),
        *("--optical-vignetting", "0.6"),
    ),
    "conventions": (
        *(
            "photo.png",
            "--disparity",
            "inverted.png",
            "--invert",
            "--disparity-range",
            "0.1,0.9",
            "-o",
            "out.png",
        ),
        *("--resize-disparity", "--blur", "20", "--focus", "0.3"),
    ),
    "metric": (*_DEPTH, "-o", "out.exr"),
    "metric_range": (*_DEPTH[:-2], "--focus-range", "2,3.5", "--mixed-depth", "on", "-o", "out.exr"),
    "metric_tilt": (*_DEPTH, "--tilt-x", "4", "--engine", "scatter", "-o", "out.exr"),
    "data_window": (
        "window.exr",
        "--depth",
        "window.exr",
        "--engine",
        "scatter",
        "--vignette",
        "1",
        "-o",
        "out.exr",
    ),
    "phone": ("portrait.jpg", "-o", "out.jpg", "--f-number", "1.4"),
    "phone_relative": ("portrait.jpg", "-o", "out.png", "--blur", "20"),
    "strips": (*_LARGE, "--max-memory", "604M", "-o", "out.png"),
    "strips_hybrid": (*_LARGE, "--engine", "hybrid", "--max-memory", "604M", "-o", "out.png"),
    "soft_map": ("photo.png", "--disparity", "soft.png", "--blur", "24", "--focus", "0.46", "-o", "out.png"),
    "wide": (
        "wide.png",
        "--disparity",
        "wide_map.png",
        "--blur",
        "8",
        "--focus",
        "0.4",
        "-o",
        "out.png",
    ),
    "supersampled": (*_LARGE, "--supersampled", "4", "-o", "out.png"),
    "large_discs": (*_PHOTO, "--blur", "200", "--focus", "0.46", "-o", "out.png"),
    "matte": (*_BASE, "--matte", "matte.png", "-o", "out.png"),
    "sequence": (
        *("frame.####.exr", "--depth", "frame.####.exr", "-o", "out.####.exr", "--frames", "1-3", *_LENS),
        *("--focus-from", "1.2", "--focus-to", "4", "--engine", "scatter", "--grain", "400"),
    ),
    "sequence_jobs": (
        *(
            "photo.png",
            "--disparity",
            "disparity.png",
            "-o",
            "out.####.png",
            "--frames",
            "8-10",
            "--jobs",
            "2",
        ),
        *("--pull", "pull.csv", "--save-maps", "maps"),
    ),
}


def write(folder: Path) -> None:
    """Render and export everything into ``folder``, one folder per case."""
    folder = folder.absolute()
    import bokehnet
    from bokehnet.cli.app import run

    print(f"bokehnet of {Path(bokehnet.__file__).parent}")
    inputs = folder / "inputs"
    inputs.mkdir(parents=True)
    make_inputs(inputs)
    for name, words in RENDERS.items():
        in_folder(folder / name, inputs, lambda words=words: run(["render", *words]))
    in_folder(folder / "demo", inputs, lambda: run(["demo", "-o", "out.png"]))
    in_folder(folder / "depth", inputs, lambda: run(["depth", "portrait.jpg", "-o", "out.exr"]))
    for name, export in _EXPORTS.items():
        in_folder(folder / name, inputs, export)


def compare(before: Path, now: Path) -> int:
    """Print the differences; return the number of files that differ by more than the tolerance."""
    wrong = 0
    names = sorted(
        path.relative_to(before) for path in before.rglob("*") if path.is_file() and not path.is_symlink()
    )
    for name in names:
        verdict = _verdict(before / name, now / name)
        wrong += verdict.startswith("WRONG")
        if verdict != "equal":
            print(f"{name!s:40} {verdict}")
    print(f"{len(names)} files, {wrong} wrong")
    return wrong


def _verdict(before: Path, now: Path) -> str:
    if not now.exists():
        return "WRONG: missing"
    if before.read_bytes() == now.read_bytes():
        return "equal"
    if before.suffix == ".tif":  # it holds the time of writing
        old, new = (oiio.ImageBuf(str(path)).get_pixels(oiio.UINT16) for path in (before, now))
        return "equal" if np.array_equal(old, new) else "WRONG: pixels differ"
    if before.suffix == ".npy":
        old, new = np.load(before), np.load(now)
    elif before.suffix == ".exr":
        old, new = (oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT) for path in (before, now))
    else:
        return "WRONG: bytes differ"
    if old.shape != new.shape:
        return f"WRONG: {old.shape} became {new.shape}"
    finite = np.isfinite(old)
    error = float(
        np.sqrt(np.mean((np.where(finite, old, 0) - np.where(finite, new, 0)) ** 2, dtype=np.float64))
    )
    peak = max(1.0, float(np.abs(old[finite]).max()))
    decibels = math.inf if error == 0 else 20 * math.log10(peak / error)
    return f"{'' if decibels >= _MIN_PSNR_DB else 'WRONG: '}{decibels:.1f} dB"


def in_folder(folder: Path, inputs: Path, action: Callable[[], int | None]) -> None:
    """Run ``action`` in a folder with links to the inputs."""
    import os

    folder.mkdir()
    for path in inputs.iterdir():
        (folder / path.name).symlink_to(path)
    os.chdir(folder)
    code = action()
    print(f"{folder.name}: {'ok' if not code else f'exit code {code}'}", flush=True)


def _export_one_file(*weights: str) -> int:
    from bokehnet.cli.app import run

    code = run(["export", "--full", "-o", "one_file.onnx", *weights])
    photo = oiio.ImageBuf("photo.png").get_pixels(oiio.FLOAT)[::2, ::2, :3]
    disparity = oiio.ImageBuf("disparity.png").get_pixels(oiio.FLOAT)[::2, ::2, 0]
    _run_model(
        Path("one_file.onnx"),
        {
            "image": photo,
            "disparity": disparity,
            "K": np.float32(12),
            "focus": np.float32(0.4),
            "gamma": np.float32(1),
        },
    )
    return code


def _write_pair() -> None:
    import torch

    from bokehnet.models.arnet import ARNet, ARNetConfig
    from bokehnet.models.iunet import IUNet, IUNetConfig
    from bokehnet.models.onnx_export import export_networks

    torch.manual_seed(0)
    networks = {"arnet": ARNet(ARNetConfig(width=8)), "iunet": IUNet(IUNetConfig(width=8))}
    export_networks(networks, Path("weights/fast"), {"classical": "scatter"})


def _export_pair() -> None:
    _write_pair()
    _run_networks(Path("weights/fast"))


def _export_one_file_random() -> int:
    import torch

    from bokehnet.models.arnet import ARNet, ARNetConfig
    from bokehnet.models.onnx_export import export_networks

    torch.manual_seed(1)
    export_networks({"arnet": ARNet(ARNetConfig(width=8))}, Path("weights/fast"), {"classical": "scatter"})
    code = _export_one_file("--weights", "weights/fast")
    shutil.rmtree("weights")
    return code


_EXPORTS: dict[str, Callable[[], int | None]] = {
    "export_one_file": _export_one_file,
    "export_one_file_random": _export_one_file_random,
    "export_pair": _export_pair,
}


def _run_networks(folder: Path) -> None:
    for path in sorted(folder.glob("*.onnx")):
        _run_model(path, None)


def _run_model(path: Path, values: dict[str, np.ndarray] | None) -> None:
    """Store the output of an exported network for one input, not its bytes, whose names may change."""
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    feeds = {}
    for index, item in enumerate(session.get_inputs()):
        if values is not None:
            feeds[item.name] = np.ascontiguousarray(values[item.name], np.float32)
            continue
        small = item.name in ("coarse", "span")
        sides = (1, 1) if item.name == "span" else (32, 48) if small else (64, 96)
        channels = item.shape[1] if isinstance(item.shape[1], int) else 3
        feeds[item.name] = rng.random((1, channels, *sides), dtype=np.float32) + (0.1 * index)
    for index, result in enumerate(session.run(None, feeds)):
        np.save(path.with_name(f"{path.stem}_{index}.npy"), result)
    path.unlink()
    for manifest in path.parent.glob("manifest.json"):
        manifest.unlink()


def _store(
    path: Path, values: np.ndarray, kind: str, channels: tuple[str, ...] = (), **attributes: object
) -> None:
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
    if channels:
        spec.channelnames = channels
        spec.alpha_channel = channels.index("A") if "A" in channels else -1
        spec.z_channel = -1
    for name, value in attributes.items():
        if name in ("x", "y", "full_x", "full_y", "full_width", "full_height"):
            setattr(spec, name, value)
        else:
            spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(values)), output.geterror()
    assert output.close()


def make_inputs(folder: Path) -> None:
    """Write the input pictures and maps of the command lines."""
    assets = _ROOT / "bokehnet/assets"
    large = oiio.ImageBuf(str(assets / "demo.png")).get_pixels(oiio.UINT8)[..., :3]
    map_of_large = oiio.ImageBuf(str(assets / "demo_disparity.png")).get_pixels(oiio.UINT16)[..., :1]
    photo, disparity = large[::2, ::2], map_of_large[::2, ::2]
    height, width = photo.shape[:2]
    _store(folder / "photo.png", photo, "uint8")
    _store(folder / "disparity.png", disparity, "uint16")
    _store(folder / "large.png", large, "uint8")
    _store(folder / "large_disparity.png", map_of_large, "uint16")
    _store(folder / "inverted.png", 65535 - disparity[::2, ::2], "uint16")
    soft = disparity.astype(np.float64)
    for axis in (0, 1):
        soft = np.mean([np.roll(soft, shift, axis) for shift in range(-4, 5)], 0)
    _store(folder / "soft.png", soft.astype(np.uint16), "uint16")
    _store(folder / "wide.png", np.tile(photo[100:196], (1, 2200 // photo.shape[1] + 1, 1)), "uint8")
    map_of_wide = np.tile(soft[100:196].astype(np.uint16), (1, 2200 // photo.shape[1] + 1, 1))
    _store(folder / "wide_map.png", map_of_wide, "uint16")
    _store(folder / "matte.png", (255 * np.clip(soft / 32768 - 0.5, 0, 1)).astype(np.uint8), "uint8")
    y, x = np.mgrid[-1:1:64j, -1:1:64j]
    star = (np.hypot(x, y) < 0.6 + 0.3 * np.cos(5 * np.arctan2(y, x)))[..., None]
    _store(folder / "star.png", 255 * star.astype(np.uint8), "uint8")
    light = (photo / 255.0) ** 2.2 * np.float32(1.5)
    near = disparity / np.float32(65535)
    metres = np.where(near > 0.02, 1 / np.maximum(near, 0.02), 1e10)
    pixels = np.concatenate([light, metres], -1).astype(np.float32)
    names = ("R", "G", "B", "Z")
    camera = {"effectiveFocalLength": 40.0, "aperture": 2.0, "focus": 1.5, "cameraAperture": 30.0}
    _store(folder / "shot.exr", pixels, "float", names, **camera, Artist="nobody", compression="zip")
    covered = np.concatenate([light, np.clip(3 * near, 0, 1), metres], -1).astype(np.float32)
    _store(
        *(folder / "window.exr", covered[10:-20, 30:], "half", ("R", "G", "B", "A", "Z")),
        **(camera | {"x": 30, "y": 10, "full_width": width, "full_height": height}),
    )
    for frame in (1, 2, 3):
        moved = np.roll(pixels[::2, ::2], 5 * frame, 1)
        _store(folder / f"frame.{frame:04d}.exr", moved, "half", names)
    (folder / "pull.csv").write_text("frame, focus, blur\n8, 0.1, 10\n10, 0.9, 24\n", encoding="utf-8")
    _make_portrait(folder / "portrait.jpg", photo, disparity)


def _make_portrait(path: Path, photo: np.ndarray, disparity: np.ndarray) -> None:
    """Write a phone photograph with an embedded map, after Google's GDepth specification; 255 is far."""
    _store(path, photo, "uint8", Exif__FocalLength=4.3, Exif__FocalLengthIn35mmFilm=28, FNumber=1.9)
    stored = path.with_name("map.png")
    _store(stored, 255 - (disparity[::2, ::2] // 257).astype(np.uint8), "uint8")
    data = base64.b64encode(stored.read_bytes()).decode()
    text = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/" '
        f'GDepth:Format="RangeInverse" GDepth:Units="m" GDepth:Near="0.6" GDepth:Far="6" '
        f'GDepth:Mime="image/png" GDepth:Data="{data}"/>'
        "</rdf:RDF></x:xmpmeta>"
    )
    payload = b"http://ns.adobe.com/xap/1.0/\0" + text.encode()
    jpeg = path.read_bytes()
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + jpeg[2:])


def main() -> int:
    """Entry point."""
    match sys.argv[1:]:
        case ["write", folder]:
            shutil.rmtree(folder, ignore_errors=True)
            write(Path(folder))
            return 0
        case ["compare", before, now]:
            return 1 if compare(Path(before), Path(now)) else 0
        case _:
            print(__doc__)
            return 2


if __name__ == "__main__":
    sys.exit(main())
