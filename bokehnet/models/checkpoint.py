"""Checkpoints: everything a training run needs to go on, in one file that is never half written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from bokehnet.config import build_config, check_same, to_dict
from bokehnet.errors import DataFileError
from bokehnet.io.atomic import write_atomic
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.error import ErrorNet, ErrorNetConfig
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.onnx_import import read_exported
from bokehnet.models.repair import RepairNet, RepairNetConfig

__all__ = ["NETWORKS", "build_network", "load_checkpoint", "load_network", "load_weights", "save_checkpoint"]


@dataclass(frozen=True)
class _Network:
    module: type
    config: type


# The name in checkpoints and manifests -> the classes.
NETWORKS = {
    "arnet": _Network(ARNet, ARNetConfig),
    "iunet": _Network(IUNet, IUNetConfig),
    "repair": _Network(RepairNet, RepairNetConfig),
    "error": _Network(ErrorNet, ErrorNetConfig),
}


# What every checkpoint has beside its name.
_PARTS = {"config", "network"}


def build_network(name: str, config: Any) -> torch.nn.Module:
    """Return a fresh network; ``config`` is its dataclass."""
    module: torch.nn.Module = NETWORKS[name].module(config)
    return module


def save_checkpoint(path: Path, name: str, config: Any, state: dict[str, Any]) -> None:
    """Write a checkpoint atomically.

    Args:
        path: Target file; an older one survives until the new one is complete.
        name: Key of ``NETWORKS``.
        config: The network's configuration.
        state: Tensors and plain values; ``state["network"]`` holds the weights to use for rendering.
    """
    content = {"name": name, "config": to_dict(config), **state}
    write_atomic(path, lambda temporary: torch.save(content, temporary), error=DataFileError)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint; only tensors and plain values are accepted.

    Raises:
        DataFileError: The file is missing, damaged or no checkpoint of ours.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise DataFileError(f"no checkpoint at {path}; train first, or correct the path") from error
    except Exception as error:  # torch.load raises a different type for each kind of damage
        raise DataFileError(f"{path}: expected a checkpoint, found something unreadable ({error})") from error
    if not isinstance(content, dict) or content.get("name") not in NETWORKS or _PARTS - content.keys():
        raise DataFileError(f"{path}: expected a checkpoint of {' or '.join(NETWORKS)}, found something else")
    return content


def load_network(path: Path, name: str) -> torch.nn.Module:
    """Return the network called ``name``, in evaluation mode.

    Args:
        path: A checkpoint, or a folder of exported networks.
        name: Key of ``NETWORKS``.

    Raises:
        DataFileError: No checkpoint of this network is there, or its weights have other shapes.
        ModelFileError: No such exported network is there, or it is damaged.
        ConfigError: Its configuration is of another version.
    """
    config, weights = read_exported(path, name) if path.is_dir() else _read_checkpoint(path, name)
    network = build_network(name, build_config(config, NETWORKS[name].config, str(path)))
    _put(weights, network, path)
    return network.eval()


def load_weights(network: torch.nn.Module, path: Path, name: str) -> None:
    """Give ``network`` the weights of the one called ``name`` in ``path``, which must have the same shape.

    Args:
        network: Its ``config`` says what shape it has.
        path: A checkpoint, or a folder of exported networks.
        name: Key of ``NETWORKS``.

    Raises:
        DataFileError, ModelFileError: As :func:`load_network`.
        ConfigError: They are of another shape or version.
    """
    other = load_network(path, name)
    way_out = "give `model` these values, or start from another network"
    check_same(f"{path}: holds weights of {name}", to_dict(other.config), to_dict(network.config), way_out)
    network.load_state_dict(other.state_dict())


def _read_checkpoint(path: Path, name: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    content = load_checkpoint(path)
    if content["name"] != name:
        raise DataFileError(f"{path}: expected a checkpoint of {name}, found one of {content['name']}")
    return content["config"], content["network"]


def _put(weights: dict[str, Tensor], network: torch.nn.Module, path: Path) -> None:
    """Load the weights of a network; an exported graph has other constants beside them."""
    wanted = network.state_dict()
    for key, x in wanted.items():
        shape, found = tuple(x.shape), tuple(weights[key].shape) if key in weights else None
        if shape != found:
            raise DataFileError(
                f"{path}: expected weights {key} of shape {shape}, found {found or 'none'}; they are of "
                "another network or version, train or export again"
            )
    network.load_state_dict({key: weights[key] for key in wanted})
