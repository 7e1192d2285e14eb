"""Methods of the benchmark, external commands or engines of this package, and their scores."""

import re
import shlex
import subprocess
import time
from collections.abc import Callable, Iterator
from json import loads
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.quality.theses import render_with
from bokehnet.errors import DataFileError, ParameterError
from bokehnet.io.image import read_image
from bokehnet.scores.flip import flip_map
from train.scores.evaluation_sets import Shot, path_traced_shots
from train.scores.metrics import depth_step_pixels, encode, psnr, similarity

__all__ = ["SCORES", "Render", "by_command", "by_engine", "score_scene"]

SCORES = ("edge_psnr", "psnr", "ssim", "flip")

# Function of scene, its folder, shot and its description; returns the scene-linear picture (H, W, 3).
Render = Callable[[dict[str, Any], Path, Shot, dict[str, Any]], np.ndarray]

_NAMES = (
    "image",
    "image_png",
    "depth",
    "disparity",
    "focal_length",
    "sensor_width",
    "f_number",
    "focus_distance",
    "blades",
    "rotation",
    "blur",
    "focus",
    "out",
    "out_png",
)


def placeholders(scene: dict[str, Any], folder: Path, shot: dict[str, Any], out: Path) -> dict[str, str]:
    """Return the value of each placeholder of a command.

    ``blur`` and ``focus`` define the radius ``blur * (d - focus)`` in pixels, with d the disparity of
    ``disparity.png`` from 0 to 1.
    """
    low, high = scene["disparity"]["min"], scene["disparity"]["max"]  # 1/m
    focal, distance = scene["focal_length_mm"], 1000 * shot["focus_distance_m"]
    pixels = scene["width"] / scene["sensor_width_mm"]
    slope = focal**2 / (2 * shot["f_number"]) * distance / (distance - focal) * pixels / 1000
    values: dict[str, Any] = {
        "image": folder / "image.exr",
        "image_png": folder / "image.png",
        "depth": folder / "depth.exr",
        "disparity": folder / "disparity.png",
        "focal_length": focal,
        "sensor_width": scene["sensor_width_mm"],
        "f_number": shot["f_number"],
        "focus_distance": shot["focus_distance_m"],
        "blades": shot["blades"],
        "rotation": shot["blade_rotation_deg"],
        "blur": slope * (high - low),
        "focus": (1000 / distance - low) / (high - low),
        "out": out / "out.exr",
        "out_png": out / "out.png",
    }
    return {name: shlex.quote(str(values[name])) for name in _NAMES}


def by_command(command: str) -> Render:
    """Return the renderer of a shell command that reads files and writes ``{out}`` or ``{out_png}``.

    Raises:
        ParameterError: The command has an unknown placeholder, or no output placeholder.
    """
    placeholders_used = set(re.findall(r"\{(\w*)\}", command))
    if unknown := placeholders_used - set(_NAMES):
        raise ParameterError(
            "--method", f"placeholders {', '.join(_NAMES)}", shown=", ".join(sorted(unknown))
        )
    if not placeholders_used & {"out", "out_png"}:
        raise ParameterError("--method", "{out} or {out_png}, where the picture goes", shown="neither")

    def render(scene: dict[str, Any], folder: Path, shot: Shot, description: dict[str, Any]) -> np.ndarray:
        with TemporaryDirectory() as out:
            filled = command
            for name, value in placeholders(scene, folder, description, Path(out)).items():
                filled = filled.replace(f"{{{name}}}", value)
            done = subprocess.run(filled, shell=True, capture_output=True, text=True, check=False)
            if done.returncode:
                messages = (done.stderr or done.stdout).strip().splitlines() or ["no output"]
                raise DataFileError(f"{filled}: exit status {done.returncode}: {messages[-1]}")
            written = [path for path in (Path(out) / "out.exr", Path(out) / "out.png") if path.exists()]
            if not written:
                raise DataFileError(f"{filled}: expected a picture at {{out}} or {{out_png}}, found none")
            return read_image(written[0])

    return render


def by_engine(name: str) -> Render:
    """Return the renderer of an engine or a baseline of this package."""
    method = render_with(name)

    def render(scene: dict[str, Any], folder: Path, shot: Shot, description: dict[str, Any]) -> np.ndarray:
        return method(shot.image, shot.defocus, shot.aperture)

    return render


def score_scene(folder: Path, render: Render) -> Iterator[dict[str, Any]]:
    """Yield the scores of every shot of a scene.

    Raises:
        DataFileError: The picture has another size, or holds NaN or infinity.
    """
    scene = loads((folder / "scene.json").read_text(encoding="utf-8"))
    for shot, description in zip(path_traced_shots(folder), scene["shots"], strict=True):
        assert shot.disparity is not None
        start = time.perf_counter()
        picture = render(scene, folder, shot, description)
        seconds = time.perf_counter() - start
        if picture.shape != shot.truth.shape or not np.isfinite(picture).all():
            problem = "NaN or infinity" if picture.shape == shot.truth.shape else f"{picture.shape}"
            raise DataFileError(
                f"{folder.name}/{description['file']}: expected finite {shot.truth.shape}, got {problem}"
            )
        truth, encoded = encode(shot.truth), encode(picture)
        squared = (encoded - truth) ** 2
        yield {
            "scene": scene["scene"],
            "shot": description["file"],
            "edge_psnr": psnr(squared[depth_step_pixels(shot.disparity, shot.defocus)]),
            "psnr": psnr(squared),
            "ssim": similarity(truth, encoded)[0],
            "flip": float(flip_map(truth, encoded).mean()),
            "seconds": seconds,
            "truth_noise": description["truth_noise"],
        }
