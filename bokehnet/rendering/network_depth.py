"""Depth guessed by a network."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from bokehnet.inference.depth_convention import find_convention
from bokehnet.inference.monocular import DepthEstimator
from bokehnet.rendering.depth_map import DepthMap, Kind, Photo

__all__ = ["NetworkDepth"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NetworkDepth:
    """Depth guessed by a monocular network in ONNX.

    Attributes:
        model: Its file.
        convention: What it sees and returns: a name, or a TOML file.
        threads: Threads inside the network; 0 takes all cores.

    Examples:
        >>> source = NetworkDepth(model="depth.onnx", threads=2)  # opened when its map is asked for
        >>> source.convention, source.kind
        ('depth-anything-v2', 'relative')
    """

    origin: ClassVar[str] = "input.depth_model"

    model: Path | str
    convention: str | Path = "depth-anything-v2"
    threads: int = 0

    @property
    def kind(self) -> Kind:
        """As its convention says."""
        return "relative" if find_convention(self.convention).unit == "none" else "metric"

    @property
    def tells_focus(self) -> bool:
        """Where distances are known, the photo's file may."""
        return self.kind == "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        estimator = DepthEstimator(self.model, find_convention(self.convention), self.threads)
        values = estimator(photo.image)
        return DepthMap(values=values, kind=self.kind, origin=self.origin, camera=photo.camera)
