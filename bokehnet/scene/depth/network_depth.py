"""Depth estimated by a network."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.inference.depth_convention import find_convention
from bokehnet.inference.depth_models import depth_model_names, find_depth_model
from bokehnet.inference.model_download import cached_file, model_file
from bokehnet.inference.monocular import DepthEstimator
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo

__all__ = ["NetworkDepth", "cached_network"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NetworkDepth:
    """Depth estimated by a monocular network in ONNX.

    Attributes:
        model: ONNX file, or a name listed by ``bokehnet models``.
        convention: Input and output format of the network: a name, or a TOML file. A named network has its
            own; the default for a file is depth-anything-v2.
        threads: Threads inside the network; 0 uses all cores.
        download: True to allow the download of a named network.
        estimator: Open network, as set by :meth:`opened`.

    Examples:
        >>> source = NetworkDepth(model="depth.onnx", threads=2)  # opened on first use
        >>> source.convention, source.kind
        ('depth-anything-v2', 'relative')
        >>> NetworkDepth(model="depth-pro").kind  # metres
        'metric'

    Raises:
        ParameterError: A convention is set for a network that has its own.
    """

    origin: ClassVar[str] = "input.depth_model"

    model: Path | str
    convention: str | Path = ""
    threads: int = 0
    download: bool = False
    estimator: DepthEstimator | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        named = find_depth_model(self.model)
        own = "depth-anything-v2" if named is None else named.convention
        if named is not None and self.convention and str(self.convention) != own:
            raise ParameterError(
                "input.depth_convention",
                expected=f"none for {named.name}, whose convention is {own}",
                got=str(self.convention),
            )
        object.__setattr__(self, "convention", self.convention or own)

    @property
    def kind(self) -> Kind:
        """Kind of depth according to the convention."""
        return "relative" if find_convention(self.convention).unit == "none" else "metric"

    @property
    def tells_focus(self) -> bool:
        """True for metric depth: the photo's file may contain a focus distance."""
        return self.kind == "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        estimator = self.estimator or self._open()
        values = estimator(photo.image)
        return DepthMap(values=values, kind=self.kind, origin=self.origin, camera=photo.camera)

    def opened(self) -> "NetworkDepth":
        """Return the source with its network open, for many pictures.

        Raises:
            BokehnetError: It cannot be opened.
        """
        return self if self.estimator is not None else replace(self, estimator=self._open())

    def _open(self) -> DepthEstimator:
        named = find_depth_model(self.model)
        file = self.model if named is None else model_file(named, allowed=self.download)
        return DepthEstimator(file, find_convention(self.convention), self.threads)


def cached_network() -> NetworkDepth | None:
    """Return the first named network on this machine; None if there is none.

    Raises:
        ModelFileError: The bytes of a network differ from the pinned ones.

    Examples:
        >>> network = cached_network()
        >>> network is None or network.kind in ("relative", "metric")
        True
    """
    for name in depth_model_names():
        model = find_depth_model(name)
        if model is None or model.refusal:
            continue
        try:
            if cached_file(model) is not None:
                return NetworkDepth(model=name)
        except MissingExtraError:  # without the package nothing was downloaded either
            return None
    return None
