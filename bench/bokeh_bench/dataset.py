"""Files of the scenes: traced once into a folder, checked against pinned block means."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bokeh_bench import VERSION, scenes
from bokeh_bench.files import BenchError, encode_srgb, read_picture, write_grey16, write_pfm, write_png
from bokeh_bench.maps import KINDS, depth_map
from bokeh_bench.metrics import edge_mask, psnr
from bokeh_bench.tracing import SKY_DEPTH, blur_radius, render

__all__ = ["TRACKS", "Case", "cases", "check", "make_scene", "prepare"]

# Rays per pixel of each of the two halves of a truth, and of the all-in-focus picture.
HALF_SAMPLES, IMAGE_SAMPLES = 256, 256

# Tracks: kind of map, and whether the picture's light is clipped at white and stored in 8 bits.
TRACKS = {kind: (kind, False) for kind in KINDS} | {"clipped": ("exact", True)}

# Maximum deviation of a pinned block mean, as a fraction of the picture's mean.
_TOLERANCE = 0.005


@dataclass(frozen=True, kw_only=True)
class Case:
    """Input of a method for one exposure in one track.

    Attributes:
        scene: Name of the scene.
        shot: Number of the exposure.
        track: Key of ``TRACKS``.
        folder: Folder of the scene's files.
        image: All-in-focus picture, scene-linear, (H, W, 3) float32; clipped in the track ``clipped``.
        depth: Depth map of the track, metres, (H, W).
        blur: Blur radius in pixels for one inverse metre of distance from focus.
        focus: Distance in focus, metres.
        f_number: F-number.
        blades: Blades; 0 is a disc. A corner of the polygon points to the right.
        focal_length: mm.
        sensor_width: mm.
    """

    scene: str
    shot: int
    track: str
    folder: Path
    image: np.ndarray
    depth: np.ndarray
    blur: float
    focus: float
    f_number: float
    blades: int
    focal_length: float
    sensor_width: float

    @property
    def defocus(self) -> np.ndarray:
        """Signed blur radius of the map, pixels, (H, W), above 0 in front of focus."""
        return np.asarray(self.blur * (1 / self.depth - 1 / self.focus))

    @property
    def map_kind(self) -> str:
        """Kind of the depth map."""
        return TRACKS[self.track][0]


def _block_means(values: np.ndarray) -> list[float]:
    rows, columns = values.shape[0] // 4, values.shape[1] // 4
    blocks = values[: 4 * rows, : 4 * columns].reshape(4, rows, 4, columns, -1)
    return [round(float(mean), 5) for mean in blocks.mean((1, 3, 4)).ravel()]


def _noise(halves: list[np.ndarray], mask: np.ndarray) -> dict[str, float]:
    """Return the PSNR of the noise of the mean of two halves, dB.

    The halves have independent noise of variance 2 v and their mean has v: their difference has 4 v.
    """
    squared = (encode_srgb(halves[0]) - encode_srgb(halves[1])) ** 2 / 4
    return {"psnr": psnr(squared), "edge_psnr": psnr(squared[mask])}


def make_scene(name: str, folder: Path) -> dict[str, Any]:
    """Trace a scene into a folder and return its description, which is also in ``scene.json``."""
    scene = scenes.draw(name)
    folder.mkdir(parents=True, exist_ok=True)
    image = render(scene.surfaces, scene.sky, scenes.camera(), IMAGE_SAMPLES, 0)
    write_pfm(folder / "image.pfm", image)
    write_png(folder / "image.png", image)
    pins = [_block_means(encode_srgb(image))]
    disparity: dict[str, dict[str, float]] = {}
    for kind in KINDS:
        depth = depth_map(kind, scene, image)
        write_pfm(folder / f"depth_{kind}.pfm", depth)
        low, high = float(1 / depth.max()), float(1 / depth.min())
        disparity[kind] = {"min": low, "max": high}
        write_grey16(folder / f"disparity_{kind}.png", (1 / depth - low) / (high - low))
        pins.append(_block_means((1 / depth - low) / (high - low)))
    depth = read_picture(folder / "depth_exact.pfm").astype(np.float64)
    shots = []
    for number, shot in enumerate(scene.shots):
        camera = scenes.camera(shot)
        halves = [
            render(scene.surfaces, scene.sky, camera, HALF_SAMPLES, 100 * number + half) for half in (1, 2)
        ]
        truth = (halves[0] + halves[1]) / 2
        write_pfm(folder / f"truth_{number}.pfm", truth)
        pins.append(_block_means(encode_srgb(truth)))
        radius = blur_radius(camera, depth)
        shots.append(
            {
                "f_number": shot.f_number,
                "focus_distance_m": shot.focus,
                "blades": shot.blades,
                "blur_px_per_inverse_m": camera.blur,
                "largest_radius_px": float(np.abs(radius).max()),
                "truth_noise": _noise(halves, edge_mask(depth, radius)),
            }
        )
    description = {
        "benchmark": VERSION,
        "scene": name,
        "width": scenes.WIDTH,
        "height": scenes.HEIGHT,
        "focal_length_mm": scenes.FOCAL_LENGTH,
        "sensor_width_mm": scenes.SENSOR_WIDTH,
        "disparity": disparity,
        "shots": shots,
        "pins": pins,
    }
    (folder / "scene.json").write_text(json.dumps(description, indent=1) + "\n", encoding="utf-8")
    return description


def check(folder: Path, description: dict[str, Any], pinned: list[list[float]] | None) -> None:
    """Check a scene against its pinned block means.

    Raises:
        BenchError: The scene is of another version, or was traced differently.
    """
    actual = description.get("pins", [])
    if description.get("benchmark") != VERSION or pinned is None or np.shape(actual) != np.shape(pinned):
        raise BenchError(f"{folder}: expected a scene of benchmark {VERSION}; remove the folder")
    for one, other in zip(np.asarray(actual), np.asarray(pinned), strict=True):
        deviation = float(np.abs(one - other).max() / max(float(np.mean(other)), 1e-6))
        if deviation > _TOLERANCE:
            raise BenchError(
                f"{folder}: expected the pinned scene of benchmark {VERSION}, found block means that"
                f" differ by {deviation:.1%}; remove the folder, or report your NumPy version"
            )


def prepare(
    folder: Path, names: list[str], pinned: dict[str, Any], report: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Trace the scenes that are missing, check all, and return their descriptions.

    Raises:
        BenchError: A scene differs from the pinned one.
    """
    result = {}
    for name in names:
        file = folder / name / "scene.json"
        if file.exists():
            description = json.loads(file.read_text(encoding="utf-8"))
        else:
            report(f"tracing {name} ...")
            description = make_scene(name, folder / name)
        check(folder / name, description, pinned.get(name))
        result[name] = description
    return result


def cases(folder: Path, description: dict[str, Any], track: str) -> list[Case]:
    """Return the cases of a scene in a track."""
    kind, clipped = TRACKS[track]
    image = read_picture(folder / ("image.png" if clipped else "image.pfm"))
    depth = read_picture(folder / f"depth_{kind}.pfm").astype(np.float64)
    return [
        Case(
            scene=description["scene"],
            shot=number,
            track=track,
            folder=folder,
            image=image,
            depth=np.clip(depth, 1e-3, SKY_DEPTH),
            blur=shot["blur_px_per_inverse_m"],
            focus=shot["focus_distance_m"],
            f_number=shot["f_number"],
            blades=shot["blades"],
            focal_length=description["focal_length_mm"],
            sensor_width=description["sensor_width_mm"],
        )
        for number, shot in enumerate(description["shots"])
    ]
