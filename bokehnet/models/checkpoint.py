"""Checkpoints: the complete state of a training run in one file, written atomically."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from bokehnet.config import build_config, check_same, to_dict
from bokehnet.errors import DataFileError
from bokehnet.io.files.atomic import write_atomic
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.bokehme import BokehMeARNet, BokehMeConfig, BokehMeIUNet
from bokehnet.models.error import ErrorNet, ErrorNetConfig
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.light import LightNet, LightNetConfig
from bokehnet.models.onnx_import import read_exported

__all__ = ["NETWORKS", "build_network", "load_checkpoint", "load_network", "load_weights", "save_checkpoint"]


@dataclass(frozen=True)
class _Network:
    module: type
    config: type


# Name in checkpoints and manifests -> classes.
NETWORKS = {
    "arnet": _Network(ARNet, ARNetConfig),
    "iunet": _Network(IUNet, IUNetConfig),
    "error": _Network(ErrorNet, ErrorNetConfig),
    "light": _Network(LightNet, LightNetConfig),
    "bokehme_arnet": _Network(BokehMeARNet, BokehMeConfig),
    "bokehme_iunet": _Network(BokehMeIUNet, BokehMeConfig),
}


# Required keys of a checkpoint, besides the name.
_REQUIRED_KEYS = {"config", "network"}


def build_network(name: str, config: Any) -> torch.nn.Module:
    """Return an untrained network; ``config`` is its dataclass."""
    module: torch.nn.Module = NETWORKS[name].module(config)
    return module


def save_checkpoint(path: Path, name: str, config: Any, state: dict[str, Any]) -> None:
    """Write a checkpoint atomically.

    Args:
        path: Target file; an existing file survives until the new one is complete.
        name: Key of ``NETWORKS``.
        config: Configuration of the network.
        state: Tensors and plain values; ``state["network"]`` holds the weights to use for rendering.
    """
    content = {"name": name, "config": to_dict(config), **state}
    write_atomic(path, lambda temporary: torch.save(content, temporary), error=DataFileError)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint; only tensors and plain values are accepted.

    Raises:
        DataFileError: The file is missing, damaged or not a bokehnet checkpoint.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise DataFileError(f"no checkpoint at {path}; train first, or correct the path") from error
    except Exception as error:  # torch.load raises a different type for each kind of damage
        raise DataFileError(f"{path}: expected a checkpoint, found something unreadable ({error})") from error
    if (
        not isinstance(content, dict)
        or content.get("name") not in NETWORKS
        or _REQUIRED_KEYS - content.keys()
    ):
        raise DataFileError(f"{path}: expected a checkpoint of {' or '.join(NETWORKS)}, found something else")
    return content


def load_network(path: Path, name: str) -> torch.nn.Module:
    """Return the network called ``name``, in evaluation mode.

    Args:
        path: Checkpoint, or folder of exported networks.
        name: Key of ``NETWORKS``.

    Raises:
        DataFileError: There is no checkpoint of this network, or its weights have other shapes.
        ModelFileError: There is no such exported network, or it is damaged.
        ConfigError: Its configuration is of another version.
    """
    config, weights = read_exported(path, name) if path.is_dir() else _read_checkpoint(path, name)
    network = build_network(name, build_config(config, NETWORKS[name].config, str(path)))
    _assign_weights(weights, network, path)
    return network.eval()


def load_weights(network: torch.nn.Module, path: Path, name: str) -> None:
    """Load the weights of network ``name`` in ``path`` into ``network``, which must have the same shape.

    Args:
        network: Network to load into; its ``config`` defines its shape.
        path: Checkpoint, or folder of exported networks.
        name: Key of ``NETWORKS``.

    Raises:
        DataFileError, ModelFileError: As in :func:`load_network`.
        ConfigError: The networks differ in shape or version.
    """
    other = load_network(path, name)
    remedy = "give `model` these values, or start from another network"
    check_same(f"{path}: holds weights of {name}", to_dict(other.config), to_dict(network.config), remedy)
    network.load_state_dict(other.state_dict())


def _read_checkpoint(path: Path, name: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    content = load_checkpoint(path)
    if content["name"] != name:
        raise DataFileError(f"{path}: expected a checkpoint of {name}, found one of {content['name']}")
    return content["config"], content["network"]


def _assign_weights(weights: dict[str, Tensor], network: torch.nn.Module, path: Path) -> None:
    """Load the weights of a network; ignores other constants of an exported graph."""
    expected = network.state_dict()
    for key, x in expected.items():
        shape, actual = tuple(x.shape), tuple(weights[key].shape) if key in weights else None
        if shape != actual:
            raise DataFileError(
                f"{path}: expected weights {key} of shape {shape}, found {actual or 'none'}; they are of "
                "another network or version, train or export again"
            )
    network.load_state_dict({key: weights[key] for key in expected})
