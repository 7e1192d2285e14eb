"""Named depth networks: repository on the hub, licence, convention, and pinned hash."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bokehnet.errors import ModelFileError

__all__ = ["PINS", "DepthModel", "depth_model_names", "find_depth_model", "recommended_model"]

_TABLE = Path(__file__).with_name("depth_models.toml")
PINS = Path(__file__).with_name("depth_model_pins.toml")


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthModel:
    """Depth network on the hub.

    Attributes:
        name: Name for ``--depth-model``.
        about: Description of its output, one line.
        repository: Repository on the hub.
        file: Path of the ONNX file in the repository; empty if none is published.
        licence: Licence, as spelled by the hub.
        convention: Name of its input and output format.
        size: Size of the download, as text.
        unpublished: Reason why there is no download; empty if there is one.
        revision: Commit of the repository; "main" if only the hash is pinned, empty until pinned.
        sha256: SHA-256 of the file, hexadecimal; empty until pinned.
        bytes: Size of the file in bytes.
        attested: Origin of revision and hash, in words.
    """

    name: str
    about: str
    repository: str
    licence: str
    convention: str
    file: str = ""
    size: str = ""
    unpublished: str = ""
    revision: str = ""
    sha256: str = ""
    bytes: int = 0
    attested: str = ""

    @property
    def refusal(self) -> str:
        """Reason why it cannot be downloaded; empty if it can."""
        if self.unpublished:
            return f"{self.repository} has no ONNX file of it: {self.unpublished}"
        if not (self.revision and self.sha256):
            return (
                f"its revision and SHA-256 are not pinned in this version, and unverified files "
                f"are not run; download {self.file} of {self.repository} yourself and use the file "
                f"with the convention {self.convention}"
            )
        return ""

    def check_available(self) -> None:
        """Raise ``ModelFileError`` if it cannot be downloaded."""
        if self.refusal:
            raise ModelFileError(f"{self.name}: {self.refusal}")


def depth_model_names() -> list[str]:
    """Return the names for ``--depth-model``, in the order of the table.

    Examples:
        >>> depth_model_names()[0]
        'depth-anything-v2-small'
    """
    return list(_table())


def find_depth_model(name: str | Path) -> DepthModel | None:
    """Return the network of a name; None if there is no such name, as for a file.

    Examples:
        >>> find_depth_model("moge-2-small").convention
        'moge-2'
        >>> find_depth_model("depth.onnx")
    """
    entry = _table().get(str(name))
    if entry is None:
        return None
    return DepthModel(name=str(name), **entry, **_read(PINS).get(str(name), {}))


def recommended_model() -> DepthModel | None:
    """Return the network to propose for a photo without depth: the first that can be downloaded.

    Examples:
        >>> recommended_model().name, recommended_model().licence
        ('depth-anything-v2-small', 'apache-2.0')
    """
    models = (find_depth_model(name) for name in depth_model_names())
    return next((model for model in models if model is not None and not model.refusal), None)


def _table() -> dict[str, dict[str, Any]]:
    return _read(_TABLE)


def _read(path: Path) -> dict[str, dict[str, Any]]:
    return tomllib.loads(path.read_text(encoding="utf-8"))
