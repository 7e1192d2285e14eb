"""Settings of ``bokehnet render`` beside those of the picture: how many frames are worked through."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import Group, setting

__all__ = ["RunSettings"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSettings(Group):
    """How the frames of a sequence are worked through."""

    GROUP: ClassVar[str] = "run"
    TITLE: ClassVar[str] = SequenceSettings.TITLE

    jobs: int | None = setting(None, "With --frames: how many are rendered at a time; default 1.", low=1)
    ray: str | None = setting(
        None,
        "With --frames: address of a Ray cluster that renders them; its machines see the same folders.",
        metavar="ADDRESS",
    )
    overwrite: bool = setting(False, "With --frames: render again what is there; default: skip it.")
    video_codec: Literal["h264", "h265", "prores", "ffv1"] | None = setting(
        None,
        "Of a video; default: prores in .mov, ffv1 in .mkv, h264 or, of more than 8 bits, h265 in .mp4.",
        metavar="NAME",
    )
    steady: Literal["on", "off"] = setting(
        "on", "Of a shot: on (default) or off: its disparity maps are made steady along its motion."
    )
