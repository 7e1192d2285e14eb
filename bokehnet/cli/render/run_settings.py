"""Settings of a run of ``bokehnet render``: parallel jobs, cluster, overwriting, video codec."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import Group, setting

__all__ = ["RunSettings"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSettings(Group):
    """Processing of the frames of a sequence."""

    GROUP: ClassVar[str] = "run"
    TITLE: ClassVar[str] = SequenceSettings.TITLE

    jobs: int | None = setting(None, "With --frames: number of parallel processes. Default: 1.", low=1)
    ray: str | None = setting(
        None,
        "With --frames: address of a Ray cluster to render on; its machines must see the same folders.",
        metavar="ADDRESS",
    )
    overwrite: bool = setting(
        False,
        "Render existing frames of a sequence again instead of skipping them. A single output is always "
        "replaced.",
    )
    video_codec: Literal["h264", "h265", "prores", "ffv1"] | None = setting(
        None,
        "Codec of a video: h264, h265, prores or ffv1. Default: prores in .mov, ffv1 in .mkv, h264 in .mp4 "
        "(h265 above 8 bits).",
        metavar="NAME",
    )
    steady: Literal["on", "off"] = setting(
        "on",
        "Temporal smoothing of relative disparity maps along the motion of a video or sequence: on (default) "
        "or off.",
    )
