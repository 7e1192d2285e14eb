"""The node that renders a shot: pulls of focus and blur, steady maps, one plan of their repair."""

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
from bokehnet.sequence.shot import Shot, SteadyDepth, decide_shot
from bokehnet.settings.settings import RenderSettings

from .host import frames_of_map, light, maps, mattes, told
from .render_nodes import BLUR, FOCUS, CommonInputs, RenderNode, common_widgets, optional_widgets


@dataclass(frozen=True)
class _Frames:
    """A batch as the frames of a shot; see :class:`bokehnet.sequence.shot.ShotFrames`."""

    image: torch.Tensor
    maps: np.ndarray
    mattes: Sequence[np.ndarray | None]
    settings: Sequence[RenderSettings]

    @property
    def count(self) -> int:
        return len(self.settings)

    def settings_of(self, index: int) -> RenderSettings:
        return self.settings[index]

    def scenes(self, wanted: Sequence[int], shot: Shot) -> Iterator[Scene]:
        for index, picture in zip(wanted, light(self.image[list(wanted)]), strict=True):
            source: DepthSource = RelativeDisparity(map=self.maps[index], as_stored=True)
            if shot.steady is not None:
                source = SteadyDepth(shot=shot.steady, index=index, origin="disparity", kind="relative")
            yield make_scene(picture, source, number=index, matte=self.mattes[index])


class BokehVideo(RenderNode):
    """Bokeh of the frames of a shot, with pulls of focus and blur; maps are taken as they are stored."""

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        steady = "Maps that flicker are made steady along the motion of the shot."
        return {
            "required": {
                **common_widgets(),
                "focus_from": ("FLOAT", FOCUS),
                "focus_to": ("FLOAT", FOCUS),
                "blur_to": ("FLOAT", {**BLUR, "tooltip": "Of the last frame; blur is that of the first."}),
            },
            "optional": {"steady": (["on", "off"], {"tooltip": steady}), **optional_widgets()},
        }

    def render(
        self, focus_from: float, focus_to: float, blur_to: float, steady: str = "on", **common: Any
    ) -> tuple[torch.Tensor, torch.Tensor, list[np.ndarray], str]:
        """Return as Bokeh Render does, frame by frame."""
        with told():
            given = CommonInputs(**common)
            if given.invert:
                raise ParameterError(
                    "invert", "false for a shot, whose maps are taken as stored", given.invert
                )
            count, values = len(given.image), maps(given.disparity)
            if count == 1:
                every = [given.settings({"value": focus_from})]
            else:
                said = given.settings(None)
                pulls = SequenceSettings(
                    focus_from=focus_from, focus_to=focus_to, blur_from=given.blur, blur_to=blur_to
                )
                pull = make_pull(tuple(range(count)), pulls, metric=False)
                every = [settings_at_frame(said, frame, pull) for frame in range(count)]
            covers = mattes(given.matte, count)
            frames = _Frames(given.image, frames_of_map(values, count), covers, every)
            moving = steady == "on" and min(count, len(values)) > 1
            with tempfile.TemporaryDirectory(dir=_own_folder()) as folder:
                shot = decide_shot(frames, self._renderer, folder=Path(folder), steady=moving, begin=_heard)
                return self.frames(frames.scenes(range(count), shot), every, shot.plan)


def _heard(label: str) -> Callable[[int, int], None]:
    """Progress of a stage before the first frame: nothing is shown of it, but cancel is heard."""

    def report(done: int, total: int) -> None:
        comfy.model_management.throw_exception_if_processing_interrupted()

    return report


def _own_folder() -> str:
    """Where ComfyUI keeps what need not last."""
    folder = Path(folder_paths.get_temp_directory())
    folder.mkdir(parents=True, exist_ok=True)
    return str(folder)
