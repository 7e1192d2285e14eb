"""Depth networks that have a name: where each lies on the hub, its licence, and which bytes it must be."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bokehnet.errors import ModelFileError

__all__ = ["PINS", "DepthModel", "depth_model_names", "find_depth_model"]

_TABLE = Path(__file__).with_name("depth_models.toml")
PINS = Path(__file__).with_name("depth_model_pins.toml")


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthModel:
    """A depth network on the hub.

    Attributes:
        name: What ``--depth-model`` calls it.
        about: What it gives, in a line.
        repository: On the hub.
        file: Path of the ONNX file in it; empty where none is published.
        licence: As the hub spells it.
        convention: What it sees and returns.
        size: Of the download, for people.
        unpublished: Why there is nothing to download; empty where there is.
        revision: Commit of the repository; empty until it is pinned.
        sha256: Of the file, hexadecimal; empty until it is pinned.
        bytes: Of the file.
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

    @property
    def refusal(self) -> str:
        """Why it cannot be downloaded; empty where it can."""
        if self.unpublished:
            return f"{self.repository} has no ONNX file of it: {self.unpublished}"
        if not (self.revision and self.sha256):
            return (
                f"its revision and SHA-256 are not pinned in this version, and bytes that nobody has checked "
                f"are not run; download {self.file} of {self.repository} yourself and give the file, "
                f"with the convention {self.convention}"
            )
        return ""

    def check_available(self) -> None:
        """Raise ``ModelFileError`` where it cannot be downloaded."""
        if self.refusal:
            raise ModelFileError(f"{self.name}: {self.refusal}")


def depth_model_names() -> list[str]:
    """Names that ``--depth-model`` knows, in the order of their table.

    Examples:
        >>> depth_model_names()[0]
        'depth-anything-v2-small'
    """
    return list(_table())


def find_depth_model(name: str | Path) -> DepthModel | None:
    """Return the network of a name; None where ``name`` is none, as that of a file.

    Examples:
        >>> find_depth_model("moge-2-small").convention
        'moge-2'
        >>> find_depth_model("depth.onnx")
    """
    entry = _table().get(str(name))
    if entry is None:
        return None
    return DepthModel(name=str(name), **entry, **_read(PINS).get(str(name), {}))


def _table() -> dict[str, dict[str, Any]]:
    return _read(_TABLE)


def _read(path: Path) -> dict[str, dict[str, Any]]:
    return tomllib.loads(path.read_text(encoding="utf-8"))
