"""``bokehnet models``: depth networks by name, and their download; consent before a first use."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.errors import MissingExtraError, ModelFileError, ParameterError

if TYPE_CHECKING:
    from bokehnet.inference.depth_models import DepthModel

__all__ = ["ensure_model", "models"]


def models(
    name: Annotated[str | None, typer.Argument(help="Tell all about this one.")] = None,
    get: Annotated[bool, typer.Option("--get", help="Download it now; this agrees to its licence.")] = False,
) -> None:
    """List the depth networks that --depth-model knows by name, or tell about one, or download it."""
    from bokehnet.inference.depth_models import depth_model_names, find_depth_model

    known = [model for each in depth_model_names() if (model := find_depth_model(each))]
    if name is None:
        if get:
            raise ParameterError("--get", expected="the name of a network before it", shown="none")
        width = max(len(model.name) for model in known)
        for model in known:
            typer.echo(f"{model.name:{width}}  {_state(model):14}  {model.licence:13}  {model.about}")
        return
    chosen = find_depth_model(name)
    if chosen is None:
        names = ", ".join(depth_model_names())
        raise ParameterError("NAME", expected=f"one of {names}", got=name)
    if get:
        from bokehnet.inference.model_download import model_file

        typer.echo(f"{chosen.name}: {model_file(chosen, allowed=True)}")
        return
    rows = {
        "about": chosen.about,
        "state": _state(chosen),
        "repository": chosen.repository,
        "file": chosen.file or "none",
        "size": chosen.size or "unknown",
        "licence": chosen.licence,
        "convention": chosen.convention,
        "revision": chosen.revision or "not pinned",
        "sha256": chosen.sha256 or "not pinned",
    }
    for key, value in rows.items():
        typer.echo(f"{key:11} {value}")
    if chosen.refusal:
        typer.echo(f"{'refused':11} {chosen.refusal}")


def ensure_model(wanted: Path | str | None) -> None:
    """See that a named network is on this machine; on a terminal, ask before it is downloaded.

    Args:
        wanted: What ``--depth-model`` says; files and None need nothing.

    Raises:
        ModelFileError: It cannot be had, or nobody has agreed.
        MissingExtraError: ``huggingface_hub`` is not installed.
    """
    if wanted is None:
        return
    from bokehnet.inference.depth_models import depth_model_names, find_depth_model

    model = find_depth_model(wanted)
    if model is None:
        if Path(wanted).suffix or Path(wanted).exists() or len(Path(wanted).parts) > 1:
            return  # a file
        names = ", ".join(depth_model_names())
        raise ModelFileError(f"{wanted}: expected an ONNX file, or one of {names}, found neither")
    from bokehnet.inference.model_download import cached_file, consent_text, downloads_allowed, model_file

    if cached_file(model) is not None:
        return
    agreed = downloads_allowed()
    if not agreed and sys.stdin.isatty() and sys.stderr.isatty():
        typer.echo(consent_text(model), err=True)
        agreed = typer.confirm("Download it?", err=True)
        if not agreed:
            raise ModelFileError(
                f"{model.name}: not downloaded, as you said; any ONNX file can be given instead"
            )
    model_file(model, allowed=agreed)


def _state(model: "DepthModel") -> str:
    """Whether it is here, can be had, or not."""
    from bokehnet.inference.model_download import cached_file

    if model.unpublished:
        return "not published"
    if model.refusal:
        return "not pinned"
    try:
        return "here" if cached_file(model) else "to download"
    except MissingExtraError:
        return "to download"
    except ModelFileError:
        return "damaged"
