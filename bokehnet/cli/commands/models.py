"""``bokehnet models``: depth networks by name, their download, and consent before the first use."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bokehnet.cli.parser import SectionedCommand, argument
from bokehnet.errors import MissingExtraError, ModelFileError, ParameterError

if TYPE_CHECKING:
    from bokehnet.inference.depth_models import DepthModel
    from bokehnet.inference.model_download import DownloadOffer
    from bokehnet.settings.settings import RenderSettings

__all__ = ["ensure_depth", "ensure_model", "models"]


@click.command(cls=SectionedCommand)
@argument("name", required=False, help="Network to describe. Default: list all.")
@click.option("--get", is_flag=True, help="Download it; this accepts its licence.")
def models(
    name: str | None,
    get: bool,
) -> None:
    """List, describe and download the networks of --depth-model."""
    from bokehnet.inference.depth_models import depth_model_names, find_depth_model

    known = [model for each in depth_model_names() if (model := find_depth_model(each))]
    if name is None:
        if get:
            raise ParameterError("--get", expected="the name of a network before it", shown="none")
        width = max(len(model.name) for model in known)
        for model in known:
            click.echo(f"{model.name:{width}}  {_state(model):14}  {model.licence:13}  {model.about}")
        return
    selected = find_depth_model(name)
    if selected is None:
        names = ", ".join(depth_model_names())
        raise ParameterError("NAME", expected=f"one of {names}", got=name)
    if get:
        from bokehnet.inference.model_download import cached_file, model_file

        if _can_ask() and cached_file(selected) is None:
            click.echo(f"downloading {selected.size} from {selected.repository}", err=True)
        click.echo(f"{selected.name}: {model_file(selected, allowed=True)}")
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
        click.echo(f"{key:11} {value}")
    if selected.refusal:
        click.echo(f"{'refused':11} {selected.refusal}")


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
    _fetch(model)


def ensure_depth(image: Path, settings: "RenderSettings") -> None:
    """Ensure that the depth of a picture is known; on a terminal, offer to download a network for it.

    Args:
        image: File of the picture.
        settings: Settings of the render.

    Raises:
        ParameterError: There is no depth; the message contains the command that downloads a network.
        ModelFileError, MissingExtraError: As :func:`ensure_model`.
    """
    from bokehnet.scene.depth.depth_source import EmbeddedDepth, depth_source
    from bokehnet.scene.depth.embedded_depth import has_own_depth, no_depth_error

    if not isinstance(depth_source(settings), EmbeddedDepth):
        ensure_model(settings.input.depth_model)
        return
    if has_own_depth(image):
        return
    from bokehnet.inference.depth_models import recommended_model
    from bokehnet.inference.model_download import check_download, downloads_allowed
    from bokehnet.scene.depth.network_depth import cached_network

    if cached_network() is not None:
        return
    model = recommended_model()
    if model is None or not (_can_ask() or downloads_allowed()):
        raise no_depth_error(image)
    check_download(model)
    click.echo(f"{image} has no depth map; a network can estimate it.", err=True)
    _fetch(model)


def _fetch(model: "DepthModel") -> None:
    """Download a network unless it is on this machine, after asking on a terminal."""
    from bokehnet.inference.model_download import downloads_allowed, fetch_model, model_file

    if not (_can_ask() or downloads_allowed()):
        model_file(model)  # raises unless it is on this machine
        return
    fetch_model(model, _agree)


def _agree(offer: "DownloadOffer") -> bool:
    click.echo(offer.text, err=True)
    return click.confirm("Download it?", err=True)


def _can_ask() -> bool:
    """Return whether a user can read a question and answer it."""
    return sys.stdin.isatty() and sys.stderr.isatty()


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
