"""Check of a submission's files: a job without depth can never run.

The service itself decodes no file; a damaged one could end it. Its check searches the bytes of the picture
for the words that every format of embedded depth contains, so that a refused job could never have run.
"""

import mmap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bokehnet.errors import MissingExtraError, ModelFileError, ParameterError
from bokehnet.inference.depth_models import find_depth_model
from bokehnet.inference.model_download import cached_file, downloads_allowed
from bokehnet.scene.depth.network_depth import cached_network
from bokehnet.serve.requests import job_settings
from bokehnet.settings.scene_settings import InputSettings

__all__ = ["check_runnable"]

# Words of which a photo with depth contains at least one: XMP of Google and Apple, items of HEIF.
_DEPTH_WORDS = (b"depth", b"Depth", b"DEPTH", b"disparity", b"Disparity", b"auxid", b"auxC")

_EXR_START = b"\x76\x2f\x31\x01"


def check_runnable(request: Mapping[str, Any], folder: Path) -> None:
    """Raise ``ParameterError`` if a job can never run.

    Args:
        request: Return value of :func:`bokehnet.serve.requests.check_request`.
        folder: Folder of its files.

    Raises:
        ParameterError: A file is empty, the picture has no depth and no other source defines it, or the depth
            network is not on the machine of the service.
    """
    for field, name in request["files"].items():
        if (folder / name).stat().st_size == 0:
            raise ParameterError(field, "a picture", shown="an empty file")
    inputs = job_settings(request, folder).input
    if inputs.depth_model is not None:
        _check_network(str(inputs.depth_model))
    if any(getattr(inputs, name) is not None for name in InputSettings.ONE_OF):
        return
    if _may_hold_depth(folder / request["files"]["image"]) or _network_is_here():
        return
    raise ParameterError(
        "image",
        "one of the files `disparity`, `depth` and `defocus`, or a picture that holds its depth",
        shown="a picture without depth alone",
        remedy="send its depth map too",
    )


def _check_network(name: str) -> None:
    model = find_depth_model(name)
    try:
        is_here = model is not None and (downloads_allowed() or cached_file(model) is not None)
    except (ModelFileError, MissingExtraError) as error:
        raise ParameterError("input.depth_model", "a network of the service", name, str(error)) from error
    if not is_here:
        remedy = f"its operator downloads it by `bokehnet models {name} --get`"
        raise ParameterError("input.depth_model", "a network on the machine of the service", name, remedy)


def _network_is_here() -> bool:
    try:
        return cached_network() is not None
    except ModelFileError:
        return False


def _may_hold_depth(path: Path) -> bool:
    """Return whether a picture may hold depth: any EXR, or a file with a word of the formats of phones."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return data[:4] == _EXR_START or any(data.find(word) >= 0 for word in _DEPTH_WORDS)
