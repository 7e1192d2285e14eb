"""``bokehnet models``: depth networks by name, their download, and consent before the first use."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.errors import MissingExtraError, ModelFileError, ParameterError

if TYPE_CHECKING:
    from bokehnet.inference.depth_models import DepthModel

__all__ = ["ensure_model", "models"]


def models(
    name: Annotated[str | None, typer.Argument(help="Network to describe. Default: list all.")] = None,
    get: Annotated[bool, typer.Option("--get", help="Download it; this accepts its licence.")] = False,
) -> None:
    """List the depth networks that --depth-model accepts by name, describe one, or download it."""
    from bokehnet.inference.depth_models import depth_model_names, find_depth_model

    known = [model for each in depth_model_names() if (model := find_depth_model(each))]
    if name is None:
        if get:
            raise ParameterError("--get", expected="the name of a network before it", shown="none")
        width = max(len(model.name) for model in known)
        for model in known:
            typer.echo(f"{model.name:{width}}  {_state(model):14}  {model.licence:13}  {model.about}")
        return
    selected = find_depth_model(name)
    if selected is None:
        names = ", ".join(depth_model_names())
        raise ParameterError("NAME", expected=f"one of {names}", got=name)
    if get:
        from bokehnet.inference.model_download import model_file

        typer.echo(f"{selected.name}: {model_file(selected, allowed=True)}")
        return
    rows = {
        "about": selected.about,
        "state": _state(selected),
        "repository": selected.repository,
        "file": selected.file or "none",
        "size": selected.size or "unknown",
        "licence": selected.licence,
        "convention": selected.convention,
        "revision": selected.revision or "not pinned",
        "sha256": selected.sha256 or "not pinned",
        "attested": selected.attested or "not pinned",
    }
    for key, value in rows.items():
        typer.echo(f"{key:11} {value}")
    if selected.refusal:
        typer.echo(f"{'refused':11} {selected.refusal}")


def ensure_model(reference: Path | str | None) -> None:
    """Ensure that a named network is on this machine; on a terminal, ask before downloading it.

    Args:
        reference: Value of ``--depth-model``; nothing is done for files and None.

    Raises:
        ModelFileError: It cannot be downloaded, or the user has not agreed.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    if reference is None:
        return
    from bokehnet.inference.depth_models import depth_model_names, find_depth_model

    model = find_depth_model(reference)
    if model is None:
        if Path(reference).suffix or Path(reference).exists() or len(Path(reference).parts) > 1:
            return  # a file
        names = ", ".join(depth_model_names())
        raise ModelFileError(f"{reference}: expected an ONNX file, or one of {names}, found neither")
    from bokehnet.inference.model_download import cached_file, consent_text, downloads_allowed, model_file

    if cached_file(model) is not None:
        return
    agreed = downloads_allowed()
    if not agreed and sys.stdin.isatty() and sys.stderr.isatty():
        typer.echo(consent_text(model), err=True)
        agreed = typer.confirm("Download it?", err=True)
        if not agreed:
            raise ModelFileError(f"{model.name}: download declined; any ONNX file can be used instead")
    model_file(model, allowed=agreed)


def _state(model: "DepthModel") -> str:
    """Return the availability of a network, as listed."""
    from bokehnet.inference.model_download import cached_file

    if model.unpublished:
        return "not published"
    if model.refusal:
        return "not pinned"
    try:
        return "downloaded" if cached_file(model) else "to download"
    except MissingExtraError:
        return "to download"
    except ModelFileError:
        return "damaged"
