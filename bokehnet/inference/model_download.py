"""Download of named depth networks from the hub into the user's cache, verified by hash before use.

The cache is that of ``huggingface_hub`` and follows its variables: ``HF_HOME`` and ``HF_HUB_CACHE`` set its
folder, ``HF_ENDPOINT`` a mirror, ``HF_HUB_OFFLINE`` disables connections, ``HF_TOKEN`` sets an account.
"""

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from bokehnet.checks import require_extra
from bokehnet.errors import ModelFileError, RenderCancelled
from bokehnet.inference.depth_models import DepthModel
from bokehnet.progress import Progress

__all__ = [
    "ALLOW",
    "DownloadOffer",
    "cached_file",
    "check_download",
    "consent_text",
    "download",
    "download_offer",
    "downloads_allowed",
    "downloads_forbidden",
    "fetch_model",
    "model_file",
]

# Environment variable that allows (1, yes, true) or forbids (0, no, false) downloads in advance.
ALLOW = "BOKEHNET_DOWNLOADS"

# Other ways to the depth of a picture.
_WITHOUT_DOWNLOAD = (
    "`bokehnet render` also takes any ONNX file by --depth-model FILE, or a map by --disparity MAP"
)

_BLOCK_BYTES = 2**20

# Seconds to wait for the connection and for the answer of the hub.
_ANSWER_TIMEOUT_S = 5.0


@dataclass(frozen=True, kw_only=True, slots=True)
class DownloadOffer:
    """Everything that a user must know before agreeing to a download.

    Attributes:
        name: Name of the network.
        about: Description of its output, one line.
        bytes: Size of the download, bytes.
        size: Size of the download, as text.
        licence: Licence, as spelled by the hub.
        source: Address of the repository.
        folder: Folder that will hold the file.
        text: All of it in one sentence or two.
    """

    name: str
    about: str
    bytes: int
    size: str
    licence: str
    source: str
    folder: str
    text: str


def download_offer(model: DepthModel) -> DownloadOffer:
    """Return what a user must know before agreeing to the download of a network.

    Raises:
        ModelFileError: The network cannot be downloaded.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    model.check_available()
    _load_hub()
    return DownloadOffer(
        name=model.name,
        about=model.about,
        bytes=model.bytes,
        size=model.size,
        licence=model.licence,
        source=f"{_endpoint()}/{model.repository}",
        folder=_folder(),
        text=consent_text(model),
    )


def fetch_model(
    model: DepthModel, agree: Callable[[DownloadOffer], bool], progress: Progress | None = None
) -> Path:
    """Return the verified file of a network; download it if the user agrees.

    Nothing is sent or stored before ``agree`` returns True. The environment variable ``BOKEHNET_DOWNLOADS``
    agrees or declines in advance.

    Args:
        model: Network.
        agree: Function that shows an offer and returns the answer; not called if the file is there, or if the
            environment forbids the download.
        progress: Called with (bytes done, total bytes); may raise ``RenderCancelled``.

    Raises:
        ModelFileError: The user has not agreed, or as :func:`download`.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    file = cached_file(model)
    if file is not None:
        return file
    check_download(model)
    offer = download_offer(model)
    if not (downloads_allowed() or agree(offer)):
        raise ModelFileError(f"{model.name}: download declined; {_WITHOUT_DOWNLOAD}")
    return download(model, progress)


def downloads_allowed() -> bool:
    """Return whether the environment allows downloads."""
    return os.environ.get(ALLOW, "").lower() in ("1", "yes", "true")


def downloads_forbidden() -> bool:
    """Return whether the environment forbids downloads."""
    return os.environ.get(ALLOW, "").lower() in ("0", "no", "false")


def check_download(model: DepthModel) -> None:
    """Raise if the environment forbids to download ``model``, so that nobody is asked in vain.

    Raises:
        ModelFileError: ``HF_HUB_OFFLINE`` is set, or ``BOKEHNET_DOWNLOADS`` is 0, no or false.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    model.check_available()
    _load_hub()
    from huggingface_hub import constants

    if constants.HF_HUB_OFFLINE:
        raise ModelFileError(
            f"{model.name}: expected a connection, HF_HUB_OFFLINE is set, and {_folder()} has no "
            f"{_source(model)}; unset it, or copy that folder from a machine that has it; {_WITHOUT_DOWNLOAD}"
        )
    if downloads_forbidden():
        raise ModelFileError(
            f"{model.name}: {ALLOW} forbids downloads, and {_folder()} has no {_source(model)}; "
            f"unset it, or copy that folder from a machine that has it; {_WITHOUT_DOWNLOAD}"
        )


def _source(model: DepthModel) -> str:
    return f"{model.file} of {model.repository} at {model.revision[:12]}"


def consent_text(model: DepthModel) -> str:
    """Return the text to consent to before downloading ``model``."""
    return (
        f"{model.name} is not on this machine. It is {model.size} from {_endpoint()}/{model.repository}, "
        f"under the licence {model.licence}, and is stored in {_folder()}. The hub sees the address of this "
        "machine and versions of Python and its packages; pictures never leave it."
    )


def model_file(model: DepthModel, *, allowed: bool = False) -> Path:
    """Return the verified file of a network; download it if allowed.

    Raises:
        ModelFileError: It cannot be downloaded, or its hash differs from the pinned one.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    file = cached_file(model)
    if file is not None:
        return file
    if downloads_forbidden():
        check_download(model)
    if not (allowed or downloads_allowed()):
        raise ModelFileError(
            f"{consent_text(model)} `bokehnet models {model.name} --get` downloads it once; "
            f"{ALLOW}=yes allows downloads in advance"
        )
    return download(model)


def cached_file(model: DepthModel) -> Path | None:
    """Return the file of a network if it is in the cache, else None.

    Raises:
        ModelFileError: The network is not pinned, or the cached file has another hash.
        MissingExtraError: As :func:`model_file`.
    """
    model.check_available()
    require_extra("huggingface_hub", "models")
    if not _has_cache_folder(model):
        return None
    _load_hub()
    from huggingface_hub import try_to_load_from_cache

    cached = try_to_load_from_cache(model.repository, model.file, revision=model.revision)
    if not isinstance(cached, str):
        return None
    return _checked(model, Path(cached))


def _has_cache_folder(model: DepthModel) -> bool:
    """Return whether the cache has files of a repository, without the import of a client of HTTP."""
    os.environ.setdefault("HF_HUB_DISABLE_TELEMETRY", "1")  # read when the constants are imported
    from huggingface_hub import constants

    return Path(constants.HF_HUB_CACHE, f"models--{model.repository.replace('/', '--')}").is_dir()


def download(model: DepthModel, progress: Progress | None = None) -> Path:
    """Download a network into the cache; the file appears complete or not at all.

    Args:
        model: Network.
        progress: Called with (bytes done, total bytes) in place of a progress bar.

    Raises:
        ModelFileError: The hub is unreachable, has no such file, or sent a file with another hash.
        MissingExtraError: As :func:`model_file`.
    """
    check_download(model)
    from huggingface_hub import errors, hf_hub_download

    source = _source(model)
    try:
        _check_connection(model)
        bar = None if progress is None else _reporting_bar(progress, model.bytes)
        downloaded = hf_hub_download(model.repository, model.file, revision=model.revision, tqdm_class=bar)
    except RenderCancelled:
        raise
    except errors.GatedRepoError as error:
        raise ModelFileError(
            f"{model.name}: {_endpoint()} requires an account that has accepted the licence of "
            f"{model.repository}; accept it there and set HF_TOKEN"
        ) from error
    except (
        errors.RepositoryNotFoundError,
        errors.RevisionNotFoundError,
        errors.RemoteEntryNotFoundError,
    ) as error:
        raise ModelFileError(f"{model.name}: {_endpoint()} has no {source}; a mirror may lack it") from error
    except Exception as error:  # transport errors have no common base
        raise ModelFileError(
            f"{model.name}: cannot be downloaded from {_endpoint()}: {_reason(error)}; set HF_ENDPOINT for a "
            f"mirror, copy {_folder()} from a machine that has it, or give {model.file} of "
            f"{model.repository} as a file with the convention {model.convention}; the next attempt resumes "
            "the download"
        ) from error
    return _checked(model, Path(downloaded))


def _check_connection(model: DepthModel) -> None:
    """Raise at once if the hub cannot be reached; ``hf_hub_download`` tries six times, within 24 s.

    Answers of a hub that is busy raise nothing: the download waits for it.
    """
    from huggingface_hub import errors, get_hf_file_metadata, hf_hub_url

    url = hf_hub_url(model.repository, model.file, revision=model.revision)
    with suppress(errors.HfHubHTTPError):  # reported by the download
        get_hf_file_metadata(url, timeout=_ANSWER_TIMEOUT_S)


def _reporting_bar(progress: Progress, total: int) -> type:
    """Return a progress bar without display that reports to a callback; ``total`` in bytes."""
    from tqdm import tqdm

    class Bar(tqdm):  # type: ignore[type-arg]
        def __init__(self, *_: Any, initial: float = 0, **__: Any) -> None:
            super().__init__(disable=True)
            self.done = initial

        def update(self, n: float | None = 1) -> None:
            self.done += n or 0
            progress(int(self.done), max(total, int(self.done)))

    return Bar


def _load_hub() -> None:
    """Import ``huggingface_hub`` without telemetry and log lines, with progress bars only on a terminal."""
    os.environ.setdefault("HF_HUB_DISABLE_TELEMETRY", "1")
    require_extra("huggingface_hub", "models")
    from huggingface_hub.utils.logging import set_verbosity
    from huggingface_hub.utils.tqdm import disable_progress_bars

    set_verbosity(logging.CRITICAL)  # configures the logger first, which the first download would reset
    if not sys.stderr.isatty():
        disable_progress_bars()


def _checked(model: DepthModel, path: Path) -> Path:
    """Return ``path`` if its hash is correct, else remove it and raise."""
    state = path.stat()
    digest = _digest(path, state.st_size, state.st_mtime_ns)
    if digest != model.sha256:
        path.resolve().unlink(missing_ok=True)  # target of the cache's link
        path.unlink(missing_ok=True)
        raise ModelFileError(
            f"{model.name}: expected SHA-256 {model.sha256}, found {digest}; "
            "the file was removed, the same command downloads it again"
        )
    return path


@cache
def _digest(path: Path, _size: int, _modified: int) -> str:
    """Return the SHA-256 of a file, computed again after a change."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def _endpoint() -> str:
    from huggingface_hub import constants

    return constants.ENDPOINT


def _folder() -> str:
    from huggingface_hub import constants

    return constants.HF_HUB_CACHE


def _reason(error: BaseException) -> str:
    """Return the root cause of an error as one line."""
    while error.__cause__ is not None:
        error = error.__cause__
    return " ".join(str(error).split()) or type(error).__name__
