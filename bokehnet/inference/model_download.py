"""Download of named depth networks from the hub into the user's cache, verified by hash before use.

The cache is that of ``huggingface_hub`` and follows its variables: ``HF_HOME`` and ``HF_HUB_CACHE`` set its
folder, ``HF_ENDPOINT`` a mirror, ``HF_HUB_OFFLINE`` disables connections, ``HF_TOKEN`` sets an account.
"""

import hashlib
import logging
import os
import sys
from functools import cache
from pathlib import Path

from bokehnet.checks import require_extra
from bokehnet.errors import ModelFileError
from bokehnet.inference.depth_models import DepthModel

__all__ = ["ALLOW", "cached_file", "consent_text", "download", "downloads_allowed", "model_file"]

# Environment variable that allows downloads in advance, for scripts and servers.
ALLOW = "BOKEHNET_DOWNLOADS"

_BLOCK_BYTES = 2**20


def downloads_allowed() -> bool:
    """Return whether the environment allows downloads."""
    return os.environ.get(ALLOW, "").lower() in ("1", "yes", "true")


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
    _load_hub()
    from huggingface_hub import try_to_load_from_cache

    cached = try_to_load_from_cache(model.repository, model.file, revision=model.revision)
    if not isinstance(cached, str):
        return None
    return _checked(model, Path(cached))


def download(model: DepthModel) -> Path:
    """Download a network into the cache; the file appears complete or not at all.

    Raises:
        ModelFileError: The hub is unreachable, has no such file, or sent a file with another hash.
        MissingExtraError: As :func:`model_file`.
    """
    model.check_available()
    _load_hub()
    from huggingface_hub import constants, errors, hf_hub_download

    source = f"{model.file} of {model.repository} at {model.revision[:12]}"
    if constants.HF_HUB_OFFLINE:
        raise ModelFileError(
            f"{model.name}: expected a connection, HF_HUB_OFFLINE is set, and {_folder()} has no {source}; "
            "unset it, or copy that folder from a machine that has it"
        )
    try:
        downloaded = hf_hub_download(model.repository, model.file, revision=model.revision)
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
            f"{model.name}: cannot be downloaded from {_endpoint()}: {_reason(error)}; "
            "set HF_ENDPOINT for a mirror; the next attempt resumes the download"
        ) from error
    return _checked(model, Path(downloaded))


def _load_hub() -> None:
    """Import ``huggingface_hub`` without telemetry and log lines, with progress bars only on a terminal."""
    os.environ.setdefault("HF_HUB_DISABLE_TELEMETRY", "1")
    require_extra("huggingface_hub", "models")
    from huggingface_hub.utils.tqdm import disable_progress_bars

    logging.getLogger("huggingface_hub").setLevel(logging.CRITICAL)
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
