"""Evaluation pictures with ground truth: shards, path-traced scenes, the BLB set."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.checks import check_choice
from bokehnet.errors import DataFileError
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_depth, read_map
from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity, disparity_from_depth
from bokehnet.synth.shards import ShardSet

__all__ = ["SETS", "Picture", "Shot", "blb_pictures", "list_pictures", "path_traced_shots", "scene_folders"]

_MM_PER_M = 1000.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shot:
    """Picture to render and its ground truth; scene-linear float32.

    Attributes:
        image: All-in-focus picture, (H, W, 3).
        defocus: Signed blur radius, pixels, (H, W).
        truth: True picture with bokeh, (H, W, 3).
        disparity: Inverse depth, (H, W), any unit; 0 is infinitely far.
        aperture: Aperture shape.
        noise: Scores of :func:`train.scores.metrics.compare` for an error equal to the noise of the truth, if
            known.
    """

    image: np.ndarray
    defocus: np.ndarray
    truth: np.ndarray
    disparity: np.ndarray | None = None
    aperture: Aperture = field(default_factory=Aperture)
    noise: dict[str, float] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Picture:
    """Reference to a shot that is read on demand; picklable."""

    scene: str
    name: str
    read: Callable[[], Shot]


def list_pictures(kind: str, folder: Path, limit: int | None = None) -> list[Picture]:
    """List the pictures of a set, in order.

    Args:
        kind: One of ``SETS``.
        folder: Folder of the set.
        limit: Maximum number of scenes.

    Raises:
        ParameterError: Unknown kind.
        DataFileError: ``folder`` holds no such set.
    """
    check_choice("kind", kind, SETS)
    pictures = SETS[kind](folder)
    if not pictures:
        raise DataFileError(f"{folder}: expected pictures of a {kind} set, found none")
    scenes = list(dict.fromkeys(picture.scene for picture in pictures))[:limit]
    return [picture for picture in pictures if picture.scene in scenes]


def shard_pictures(folder: Path) -> list[Picture]:
    """List every view of every sample of the shards that ``bokehnet synth`` wrote."""
    samples = ShardSet(folder)
    views = int(samples.description.get("views", 1))
    return [
        Picture(scene=f"{index:06d}", name=f"view {view}", read=partial(_read_shard, samples, index, view))
        for index in range(len(samples))
        for view in range(views)
    ]


def _read_shard(samples: ShardSet, index: int, view: int) -> Shot:
    sample = samples[index]
    return Shot(
        image=sample.image.astype(np.float32),
        disparity=sample.disparity,
        defocus=defocus_from_disparity(sample.disparity, sample.blur[view], sample.focus[view]),
        truth=sample.bokeh[view].astype(np.float32),
    )


def scene_folders(folder: Path) -> list[Path]:
    """List the folders of path-traced scenes in ``folder``, by name."""
    return sorted(path.parent for path in folder.glob("*/scene.json"))


def path_traced_pictures(folder: Path) -> list[Picture]:
    """List every shot of path-traced scenes, one folder per scene.

    A folder holds ``image.exr``, ``depth.exr`` (metres), the true picture of every shot, and ``scene.json``
    with ``width`` (pixels), ``focal_length_mm``, ``sensor_width_mm`` and ``shots``: ``file``, ``f_number``,
    ``focus_distance_m``, ``blades``, ``blade_rotation_deg``.
    """
    return [
        Picture(scene=path.name, name=shot["file"], read=partial(_read_path_traced, path, scene, shot))
        for path in scene_folders(folder)
        for scene in [_read_description(path / "scene.json", "shots")]
        for shot in scene["shots"]
    ]


def path_traced_shots(folder: Path) -> Iterator[Shot]:
    """Return an iterator over the shots of one path-traced scene."""
    scene = _read_description(folder / "scene.json", "shots")
    return (_read_path_traced(folder, scene, shot) for shot in scene["shots"])


def _read_path_traced(folder: Path, scene: dict[str, Any], shot: dict[str, Any]) -> Shot:
    lens = ThinLens(
        focal_length=scene["focal_length_mm"],
        f_number=shot["f_number"],
        focus_distance=_MM_PER_M * shot["focus_distance_m"],
    )
    disparity = disparity_from_depth(read_depth(folder / "depth.exr"))
    return Shot(
        image=read_image(folder / "image.exr"),
        disparity=disparity,
        defocus=defocus_map(disparity, lens, scene["sensor_width_mm"] / scene["width"]),
        truth=read_image(folder / shot["file"]),
        aperture=Aperture(blades=shot["blades"], rotation=shot["blade_rotation_deg"]),
    )


def blb_pictures(folder: Path) -> list[Picture]:
    """List every picture of scenes in the layout of the BLB set, one folder per scene.

    - ``image.exr``: all-in-focus picture, scene-linear.
    - ``depth.exr``: depth along the axis; very large for the sky. Or ``disparity.exr``: its inverse, 0 for
      the sky, not normalised; it takes precedence over depth.
    - ``info.json``: ``blur_parameters`` (K of each level) and ``focus_distances``, in the unit of depth.
    - ``bokeh_II_JJ.exr``: the true picture for level II and focus distance JJ, both counted from 0.

    The blur radius is K * (disparity - 1 / focus distance) pixels. The all-in-focus and the true picture are
    clipped to [0, 1], as by the set's authors.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022, and what its
        authors answered about the set at github.com/JuewenPeng/BokehMe, issues 4 and 13.
    """
    pictures = []
    for path in sorted(folder.glob("*/info.json")):
        info = _read_description(path, "blur_parameters", "focus_distances")
        for truth in sorted(path.parent.glob("bokeh_*_*.exr")):
            match = re.fullmatch(r"bokeh_(\d+)_(\d+)", truth.stem)
            if match is None:
                continue
            level, index = (int(number) for number in match.groups())
            try:
                blur, focus = float(info["blur_parameters"][level]), 1 / float(info["focus_distances"][index])
            except (LookupError, TypeError, ValueError, ZeroDivisionError) as error:
                message = f"no blur parameter {level} or focus distance {index} for {truth.name}"
                raise DataFileError(f"{path}: {message}") from error
            read = partial(_read_blb, truth, blur, focus)
            pictures.append(Picture(scene=path.parent.name, name=truth.stem, read=read))
    return pictures


def _read_blb(truth: Path, blur: float, focus: float) -> Shot:
    disparity_path = truth.with_name("disparity.exr")
    if disparity_path.exists():
        disparity = read_map(disparity_path)
    else:
        disparity = _MM_PER_M * disparity_from_depth(read_depth(truth.with_name("depth.exr")))
    return Shot(
        image=np.clip(read_image(truth.with_name("image.exr")), 0, 1),
        disparity=disparity,
        defocus=defocus_from_disparity(disparity, np.float32(blur), np.float32(focus)),
        truth=np.clip(read_image(truth), 0, 1),
    )


def _read_description(path: Path, *keys: str) -> dict[str, Any]:
    """Read a JSON file that must have ``keys``."""
    try:
        description: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        missing = [key for key in keys if key not in description]
    except (OSError, ValueError, TypeError) as error:
        raise DataFileError(f"{path}: expected the description of a scene: {error}") from error
    if missing:
        raise DataFileError(f"{path}: expected the description of a scene, found no {', '.join(missing)}")
    return description


SETS: dict[str, Callable[[Path], list[Picture]]] = {
    "shards": shard_pictures,
    "cycles": path_traced_pictures,
    "blb": blb_pictures,
}
