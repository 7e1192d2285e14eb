"""Node that renders a shot: focus and blur pulls, temporally filtered maps, one repair plan."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import comfy.model_management
import folder_paths
import numpy as np
import torch

from bokehnet.errors import ParameterError
from bokehnet.scene.depth.depth_source import DepthSource, RelativeDisparity
from bokehnet.scene.scene import Scene, make_scene
from bokehnet.sequence.sequence import SequenceSettings, make_pull, settings_at_frame
from bokehnet.sequence.shot import FilteredDepth, Shot, analyse_shot, probe_frames
from bokehnet.settings.settings import RenderSettings

from .host import frames_of_map, light, maps, mattes, node_errors
from .render_nodes import BLUR, FOCUS, CommonInputs, RenderNode, common_widgets, optional_widgets


@dataclass(frozen=True)
class _Frames:
    """A batch of pictures as the frames of a shot; see :class:`bokehnet.sequence.shot.ShotFrames`."""

    image: torch.Tensor
    maps: np.ndarray
    mattes: Sequence[np.ndarray | None]
    settings: Sequence[RenderSettings]

    @property
    def are_files(self) -> bool:
        return False

    @property
    def numbers(self) -> range:
        return range(len(self.settings))

    @property
    def selected(self) -> range:
        return self.numbers

    @property
    def probes(self) -> list[int]:
        return probe_frames(self.numbers)

    def settings_of(self, index: int) -> RenderSettings:
        return self.settings[index]

    def scenes(self, indices: Sequence[int], shot: Shot) -> Iterator[Scene]:
        for index, picture in zip(indices, light(self.image[list(indices)]), strict=True):
            source: DepthSource = RelativeDisparity(map=self.maps[index], as_stored=True)
            if shot.steady is not None:
                source = FilteredDepth(shot=shot.steady, number=index, origin="disparity", kind="relative")
            yield make_scene(picture, source, number=index, matte=self.mattes[index])


class BokehVideo(RenderNode):
    """Renders the bokeh of a shot, with pulls of focus and blur; maps are used as stored."""

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        steady = "Filters flickering maps over time along the motion of the shot."
        return {
            "required": {
                **common_widgets(),
                "blur": (
                    "FLOAT",
                    {**BLUR, "tooltip": "Blur of the first frame, pixels per unit of disparity."},
                ),
                "focus_from": ("FLOAT", FOCUS),
                "focus_to": ("FLOAT", FOCUS),
                "blur_to": (
                    "FLOAT",
                    {**BLUR, "tooltip": "Blur of the last frame."},
                ),
            },
            "optional": {"steady": (["on", "off"], {"tooltip": steady}), **optional_widgets()},
        }

    def render(
        self, focus_from: float, focus_to: float, blur_to: float, steady: str = "on", **common: Any
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Return the outputs of Bokeh Render for each frame."""
        with node_errors():
            inputs = CommonInputs(**common)
            if inputs.invert:
                raise ParameterError(
                    "invert", "false for a shot, whose maps are used as stored", inputs.invert
                )
            count, values = len(inputs.image), maps(inputs.disparity)
            if count == 1:
                settings = [inputs.settings({"value": focus_from})]
            else:
                base = inputs.settings(None)
                pulls = SequenceSettings(
                    focus_from=focus_from, focus_to=focus_to, blur_from=inputs.blur, blur_to=blur_to
                )
                pull = make_pull(tuple(range(count)), pulls, metric=False)
                settings = [settings_at_frame(base, frame, pull) for frame in range(count)]
            frames = _Frames(
                inputs.image, frames_of_map(values, count), mattes(inputs.matte, count), settings
            )
            filtered = steady == "on" and min(count, len(values)) > 1
            with tempfile.TemporaryDirectory(dir=_temporary_root()) as folder:
                shot = analyse_shot(
                    frames, self._renderer, folder=Path(folder), steady=filtered, begin=_cancellable
                )
                return self.frames(frames.scenes(range(count), shot), settings, shot.plan)


def _cancellable(label: str) -> Callable[[int, int], None]:
    """Return the progress callback of an analysis stage: it shows nothing, but raises on cancellation."""

    def report(done: int, total: int) -> None:
        comfy.model_management.throw_exception_if_processing_interrupted()

    return report


def _temporary_root() -> str:
    """Return ComfyUI's folder for temporary files."""
    folder = Path(folder_paths.get_temp_directory())
    folder.mkdir(parents=True, exist_ok=True)
    return str(folder)
