"""Opened scene file: one picture at a time, newer requests end older ones."""

import io
import math
import shutil
import tempfile
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from bokehnet.checks import number_of
from bokehnet.errors import ParameterError
from bokehnet.io.color.color_space import SRGB
from bokehnet.scenes.preview import ScenePreview, View
from bokehnet.scenes.tables import LensTable
from bokehnet.studio.preview.display import to_rgba

__all__ = ["ScenePicture", "SceneSession"]

_JPEG_QUALITY = 88
_MAX_WIDTH_PX = 1280
_MAX_STOPS = 20.0


@dataclass(frozen=True, kw_only=True)
class ScenePicture:
    """Encoded picture of a scene.

    Attributes:
        jpeg: JPEG file.
        stage: ``draft`` or ``traced``.
        samples: Samples per pixel; 0 for a draft.
        focus_distance: Distance in focus, m.
    """

    jpeg: bytes
    stage: str
    samples: int
    focus_distance: float


class SceneSession:
    """Session of the previewer.

    Args:
        path: Scene file, or mesh file.

    Raises:
        ConfigError: Anything in the scene is wrong.
        MissingExtraError: PyTorch is missing, or Embree for a scene with meshes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._preview = ScenePreview(path)
        self.folder = Path(tempfile.mkdtemp(prefix="bokehnet_scene_"))
        self._newest = 0
        self._counter, self._tracing = threading.Lock(), threading.Lock()

    def close(self) -> None:
        """Stop and remove the session's files."""
        self._begin()
        shutil.rmtree(self.folder, ignore_errors=True)

    def state(self) -> dict[str, Any]:
        """Return name, lenses, proportions and samples of the scene for the page."""
        preview = self._preview
        lens = preview.lens
        return {
            "name": self.path.name,
            "ratio": preview.ratio,
            "samples": preview.samples,
            "lenses": preview.lenses,
            "lens": {
                "name": lens.name,
                "focal_length": lens.focal_length,
                "f_number": lens.f_number,
                "focus_distance": _finite(lens.focus_distance),
            },
        }

    def pictures(self, request: Mapping[str, Any]) -> Iterator[ScenePicture]:
        """Yield the draft of a view, then traced pictures until a newer request begins.

        Args:
            request: Values of the page: ``azimuth``, ``elevation``, ``zoom``, ``lens``, ``exposure`` in
                stops, ``width`` of the traced picture, ``draft_width``, ``focus_at`` (x, y), and ``moving``:
                the draft alone.

        Raises:
            BokehnetError: A value is wrong, or the lens cannot be set up so.
        """
        number = self._begin()
        gain = 2.0 ** _number(request, "exposure", 0.0, -_MAX_STOPS, _MAX_STOPS)
        draft = self._view(request, "draft_width")
        if request.get("focus_at") is not None:
            x, y = (float(value) for value in request["focus_at"])
            depth = self._preview.focus_at(draft, x, y)
            draft = replace(draft, lens=replace(draft.lens, focus_distance=depth))
        focus = draft.lens.focus_distance
        yield _encoded(self._preview.draft(draft) * gain, "draft", 0, focus)
        if request.get("moving"):
            return
        view = replace(draft, width=self._view(request, "width").width)
        with self._tracing:
            for picture, samples in self._preview.refine(view, lambda: number != self._newest):
                yield _encoded(picture * gain, "traced", samples, focus)

    def _begin(self) -> int:
        """Return the number of a new request, which ends all older ones."""
        with self._counter:
            self._newest += 1
            return self._newest

    def _view(self, request: Mapping[str, Any], width: str) -> View:
        lens = dict(request.get("lens") or {})
        focus = lens.get("focus_distance")
        table = LensTable(
            name=str(lens.get("name", self._preview.lens.name)),
            focal_length=_optional(lens, "focal_length"),
            f_number=_optional(lens, "f_number"),
            focus_distance=math.inf if focus is None else number_of(focus),
        )
        if table.name not in self._preview.lenses:
            raise ParameterError("lens", f"one of {', '.join(self._preview.lenses)}", table.name)
        return View(
            lens=table,
            azimuth=_number(request, "azimuth", 0.0, -1e4, 1e4),
            elevation=_number(request, "elevation", 0.0, -89, 89),
            zoom=_number(request, "zoom", 1.0, 0.05, 20),
            width=round(_number(request, width, 320, 16, _MAX_WIDTH_PX)),
        )


def _number(values: Mapping[str, Any], name: str, default: float, low: float, high: float) -> float:
    number = number_of(values.get(name, default))
    if not low <= number <= high:
        raise ParameterError(name, f"{low:g} to {high:g}", values.get(name))
    return number


def _optional(values: Mapping[str, Any], name: str) -> float | None:
    value = values.get(name)
    return None if value is None else number_of(value)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _encoded(light: np.ndarray, stage: str, samples: int, focus: float) -> ScenePicture:
    file = io.BytesIO()
    pixels = to_rgba(np.ascontiguousarray(light, np.float32), SRGB)[..., :3]
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "JPEG", quality=_JPEG_QUALITY, subsampling=0)
    return ScenePicture(jpeg=file.getvalue(), stage=stage, samples=samples, focus_distance=focus)
