"""Files of named depth networks: from the hub into the user's cache, never run unless their hash is right.

The cache is that of ``huggingface_hub`` and follows its variables: ``HF_HOME`` and ``HF_HUB_CACHE`` for the
place, ``HF_ENDPOINT`` for a mirror, ``HF_HUB_OFFLINE`` for no connection at all, ``HF_TOKEN`` for an account.
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

# Variable that agrees to downloads ahead, for scripts and servers.
ALLOW = "BOKEHNET_DOWNLOADS"

_BLOCK = 2**20  # bytes


def downloads_allowed() -> bool:
    """Whether the environment agrees to downloads."""
    return os.environ.get(ALLOW, "").lower() in ("1", "yes", "true")


def consent_text(model: DepthModel) -> str:
    """What somebody agrees to who lets ``model`` be downloaded."""
    return (
        f"{model.name} is not on this machine. It is {model.size} from {_endpoint()}/{model.repository}, "
        f"under the licence {model.licence}, and stays in {_folder()}. The hub sees the address of this "
        "machine and versions of Python and its packages; pictures never leave it."
    )


def model_file(model: DepthModel, *, allowed: bool = False) -> Path:
    """Return the file of a network, whose hash is checked; it is downloaded where that is allowed.

    Raises:
        ModelFileError: It cannot be had, or its bytes are others than those that are pinned.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    found = cached_file(model)
    if found is not None:
        return found
    if not (allowed or downloads_allowed()):
        raise ModelFileError(
            f"{consent_text(model)} bokehnet models {model.name} --get downloads it once; "
            f"{ALLOW}=yes agrees ahead"
        )
    return download(model)


def cached_file(model: DepthModel) -> Path | None:
    """Return its file where the cache has it; None where it does not.

    Raises:
        ModelFileError: It has no pins, or the cached bytes are others.
        MissingExtraError: As :func:`model_file`.
    """
    model.check_available()
    _load_hub()
    from huggingface_hub import try_to_load_from_cache

    found = try_to_load_from_cache(model.repository, model.file, revision=model.revision)
    if not isinstance(found, str):
        return None
    return _checked(model, Path(found))


def download(model: DepthModel) -> Path:
    """Download a network into the cache; it is there whole or not at all.

    Raises:
        ModelFileError: The hub cannot be reached, has no such file, or gave other bytes.
        MissingExtraError: As :func:`model_file`.
    """
    model.check_available()
    _load_hub()
    from huggingface_hub import constants, errors, hf_hub_download

    where = f"{model.file} of {model.repository} at {model.revision[:12]}"
    if constants.HF_HUB_OFFLINE:
        raise ModelFileError(
            f"{model.name}: expected a connection, found HF_HUB_OFFLINE set, and {_folder()} has no {where}; "
            "unset it, or copy that folder from a machine that has it"
        )
    try:
        found = hf_hub_download(model.repository, model.file, revision=model.revision)
    except errors.GatedRepoError as error:
        raise ModelFileError(
            f"{model.name}: {_endpoint()} wants an account that has agreed to the licence of "
            f"{model.repository}; agree there and set HF_TOKEN"
        ) from error
    except (
        errors.RepositoryNotFoundError,
        errors.RevisionNotFoundError,
        errors.RemoteEntryNotFoundError,
    ) as error:
        raise ModelFileError(f"{model.name}: {_endpoint()} has no {where}; a mirror may lack it") from error
    except Exception as error:  # of the transport, whose errors have no common base
        raise ModelFileError(
            f"{model.name}: cannot be downloaded from {_endpoint()}: {_reason(error)}; "
            "HF_ENDPOINT can name a mirror, and what came so far is used again"
        ) from error
    return _checked(model, Path(found))


def _load_hub() -> None:
    """Import ``huggingface_hub``: no telemetry, no lines of its own, bars only where somebody watches."""
    os.environ.setdefault("HF_HUB_DISABLE_TELEMETRY", "1")
    require_extra("huggingface_hub", "models")
    from huggingface_hub.utils.tqdm import disable_progress_bars

    logging.getLogger("huggingface_hub").setLevel(logging.CRITICAL)
    if not sys.stderr.isatty():
        disable_progress_bars()


def _checked(model: DepthModel, path: Path) -> Path:
    """Return ``path`` if its hash is right, else remove it and raise."""
    state = path.stat()
    digest = _digest(path, state.st_size, state.st_mtime_ns)
    if digest != model.sha256:
        path.resolve().unlink(missing_ok=True)  # a link of the cache leads to the bytes
        path.unlink(missing_ok=True)
        raise ModelFileError(
            f"{model.name}: expected SHA-256 {model.sha256}, found {digest}; "
            "the file was removed, the same command downloads it again"
        )
    return path


@cache
def _digest(path: Path, _size: int, _modified: int) -> str:
    """SHA-256 of a file, computed again when it has changed."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _endpoint() -> str:
    from huggingface_hub import constants

    return constants.ENDPOINT


def _folder() -> str:
    from huggingface_hub import constants

    return constants.HF_HUB_CACHE


def _reason(error: BaseException) -> str:
    """The first cause that says something, in one line."""
    while error.__cause__ is not None:
        error = error.__cause__
    return " ".join(str(error).split()) or type(error).__name__
