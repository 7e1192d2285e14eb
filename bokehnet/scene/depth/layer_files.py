"""Known layers of a scene: successive surfaces from renderers or artists."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_finite, check_rank
from bokehnet.errors import ImageFileError, ParameterError, ShapeError
from bokehnet.io.channels import read_channels
from bokehnet.io.exr.deep import deep_layers
from bokehnet.io.exr.header import is_exr
from bokehnet.io.maps import depth_to_mm
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import find_picture
from bokehnet.optics.pixels.over import transmittance
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo, SceneLayers

__all__ = ["LayeredDepth", "flattened", "make_layers", "read_layers"]

# Maximum number of layers per pixel after merging deep samples.
_MAX_LAYERS = 6

# Relative tolerance of the depth order of layers, for rounding errors.
_ORDER_TOLERANCE = 1e-5

Array = npt.NDArray[np.float32]


def make_layers(
    pictures: Sequence[npt.NDArray[np.floating]],
    depths: Sequence[npt.NDArray[np.floating]],
    unit: str = "m",
) -> SceneLayers:
    """Return layers made of pictures and their depths, front to back.

    Args:
        pictures: One or more pictures, scene-linear, premultiplied, with alpha, (H, W, 4) each.
        depths: Depth of each picture, (H, W); ignored where alpha is 0.
        unit: Unit of the depths.

    Raises:
        ShapeError: Their numbers or sizes differ.
        ParameterError: No layer; NaN, infinity or alpha outside 0 to 1; a layer nearer than an earlier one.

    Examples:
        >>> leaf, wall = np.zeros((1, 2, 4)), np.ones((1, 2, 4))
        >>> leaf[0, 0] = [0, 0.5, 0, 0.5]
        >>> layers = make_layers([leaf, wall], [np.full((1, 2), 1.0), np.full((1, 2), 3.0)])
        >>> layers.coverage.tolist(), layers.colors[0, 0, 0].tolist()
        ([[[0.5, 1.0], [0.0, 1.0]]], [0.0, 1.0, 0.0])
    """
    if not pictures:
        raise ParameterError("layers", "one picture or more", shown="none")
    if len(pictures) != len(depths):
        raise ShapeError(f"layers: expected a depth for each of {len(pictures)} pictures, got {len(depths)}")
    colors, values, coverage = [], [], []
    for number, (picture, depth) in enumerate(zip(pictures, depths, strict=True), 1):
        name = f"layer {number}"
        check_rank(name, picture, 3, "(H, W, 4)")
        check_rank(f"{name} depth", depth, 2, "(H, W)")
        size = np.shape(pictures[0])[:2]
        if picture.shape != (*size, 4) or depth.shape != size:
            expected = f"{size[1]}x{size[0]} pixels of four channels, and a depth of the same size"
            raise ShapeError(f"{name}: expected {expected}, got {picture.shape} and {depth.shape}")
        check_finite(name, picture)
        alpha = np.asarray(picture[..., 3], np.float32)
        if alpha.min() < 0 or alpha.max() > 1:
            actual = f"{alpha.min():g} to {alpha.max():g}"
            raise ParameterError(f"{name} alpha", "0 to 1", shown=actual, remedy="clip it first")
        light = np.asarray(picture[..., :3], np.float32)
        colors.append(
            np.divide(light, alpha[..., None], out=np.zeros_like(light), where=alpha[..., None] > 0)
        )
        values.append(_disparity(np.where(alpha > 0, depth, np.inf), unit))
        coverage.append(alpha)
    return _ordered(np.stack(colors, 2), np.stack(values, 2), np.stack(coverage, 2), "layers")


def _ordered(colors: Array, values: Array, coverage: Array, name: str) -> SceneLayers:
    """Return layers with the previous depth in empty pixels; raise ``ParameterError`` for a wrong order."""
    previous = np.full(values.shape[:2], np.inf, np.float32)
    values = values.copy()
    for layer in range(values.shape[2]):
        current, covered = values[:, :, layer], coverage[:, :, layer] > 0
        wrong = covered & (current > previous * (1 + _ORDER_TOLERANCE))
        if wrong.any():
            y, x = np.argwhere(wrong)[0]
            actual = (
                f"layer {layer + 1} nearer than an earlier one in {int(wrong.sum())} pixels, as at {x},{y}"
            )
            raise ParameterError(
                name, "surfaces from front to back", shown=actual, remedy="sort them by depth"
            )
        previous = np.where(covered, np.minimum(current, previous), previous)
        values[:, :, layer] = previous
    nearest = values.max(axis=2, where=np.isfinite(values), initial=0)
    values = np.where(np.isfinite(values), values, nearest[..., None])
    return SceneLayers(colors=colors, values=values, coverage=coverage)


def read_layers(path: Path | str, unit: str = "m") -> SceneLayers:
    """Read a layered EXR, as written by ``bokehnet trace --layers``, or a deep EXR.

    Deep samples of a pixel are merged to at most six layers, split at the widest gaps in disparity.

    Args:
        path: File with ``layer1.R``, ``.G``, ``.B``, ``.Z``, ``.coverage`` etc., or with a deep picture.
        unit: Unit of Z.

    Raises:
        ImageFileError: The file cannot be read or contains neither.
        ParameterError: Its layers are not from front to back.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from bokehnet.io.channels import write_channels
        >>> bands = {f"layer1.{name}": np.ones((2, 3)) for name in ("R", "G", "B", "Z", "coverage")}
        >>> with TemporaryDirectory() as folder:
        ...     write_channels(Path(folder, "wall.exr"), bands)
        ...     layers = read_layers(Path(folder, "wall.exr"))
        >>> layers.coverage.shape
        (2, 3, 1)
    """
    if not is_exr(Path(path)):
        raise ImageFileError(f"{path}: expected an EXR file with layers")
    with ImageFile(path) as file:
        picture = find_picture(file) if any(part.deep for part in file.parts) else None
        if picture is not None and picture.part.deep:
            names = list(picture.colours)
            bands = [
                deep_layers(file.read_deep(picture.part, names, rows), names, _MAX_LAYERS)
                for rows in file.bands(picture.part)
            ]
            colors, depth, coverage = (np.concatenate(column) for column in zip(*bands, strict=True))
            colors = np.broadcast_to(colors, (*depth.shape, 3))  # also for one colour channel
            return _ordered(colors, _disparity(depth, unit), coverage, "input.layers")
    channels = read_channels(path).channels
    count = 0
    while f"layer{count + 1}.coverage" in channels:
        count += 1
    required = [f"layer{number}.{name}" for number in range(1, count + 1) for name in ("R", "G", "B", "Z")]
    missing = [name for name in required if name not in channels]
    if not count or missing:
        actual = f"no {missing[0]}" if missing else ", ".join(sorted(channels)[:6])
        raise ImageFileError(f"{path}: expected layers (layer1.R .G .B .Z .coverage, ...), found {actual}")

    def stacked(name: str) -> Array:
        return np.stack([channels[f"layer{number}.{name}"] for number in range(1, count + 1)], -1)

    colors, coverage = np.stack([stacked(name) for name in "RGB"], -1), stacked("coverage")
    bad = int((~np.isfinite(colors)).sum() + (~((coverage >= 0) & (coverage <= 1))).sum())
    if bad:
        raise ImageFileError(f"{path}: expected finite light and coverage of 0 to 1, found {bad} others")
    return _ordered(colors, _disparity(stacked("Z"), unit), coverage, "input.layers")


def _disparity(depth: Array, unit: str) -> Array:
    from bokehnet.optics.coc import disparity_from_depth  # imports numba, 0.2 s

    flat = disparity_from_depth(depth_to_mm(depth.reshape(len(depth), -1), unit))
    return np.asarray(flat, np.float32).reshape(depth.shape)


def flattened(layers: SceneLayers) -> tuple[Array, Array]:
    """Return the composite of layers, (H, W, 3), and its depth value (H, W) at half of its coverage.

    Examples:
        >>> wall = make_layers([np.full((1, 2, 4), 1.0)], [np.full((1, 2), 2.0)])
        >>> picture, disparity = flattened(wall)
        >>> picture[0, 0].tolist(), (1000 * disparity).tolist()
        ([1.0, 1.0, 1.0], [[0.5, 0.5]])
    """
    through, ahead = transmittance(layers.coverage)
    picture = np.einsum("yxl,yxlc->yxc", ahead * layers.coverage, layers.colors)
    reached = 1 - through >= 0.5 * (1 - through[..., -1:])
    first = reached.argmax(axis=2)
    return picture, np.take_along_axis(layers.values, first[..., None], 2)[..., 0]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LayeredDepth:
    """Depth from layers, whose occluded surfaces engine rays uses as well.

    Attributes:
        layers: Layered or deep EXR file, or the result of :func:`make_layers`.
        unit: Unit of the depth in a file.

    Examples:
        >>> from bokehnet.scene.scene import make_scene
        >>> layers = make_layers([np.full((4, 6, 4), 1.0)], [np.full((4, 6), 2.0)])
        >>> scene = make_scene(flattened(layers)[0], LayeredDepth(layers=layers))
        >>> float(1000 * scene.depth.values[0, 0])
        0.5
    """

    origin: ClassVar[str] = "input.layers"
    kind: ClassVar[Kind | None] = "metric"
    tells_focus: ClassVar[bool] = True

    layers: Path | str | SceneLayers
    unit: str = "m"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        source = self.layers
        layers = source if isinstance(source, SceneLayers) else read_layers(source, self.unit)
        if layers.values.shape[:2] != photo.image.shape[:2]:
            sizes = [f"{shape[1]}x{shape[0]}" for shape in (photo.image.shape, layers.values.shape)]
            raise ShapeError(f"input.layers: expected {sizes[0]} pixels like the picture, got {sizes[1]}")
        return DepthMap(
            values=flattened(layers)[1], kind="metric", origin=self.origin, camera=photo.camera, layers=layers
        )
