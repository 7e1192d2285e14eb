"""Checkpoints: everything a training run needs to go on, in one file that is never half written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from bokehnet.config import build_config, to_dict
from bokehnet.errors import DataFileError
from bokehnet.io.atomic import write_atomic
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.edges import EdgeNet, EdgeNetConfig
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.repair import RepairNet, RepairNetConfig

__all__ = ["NETWORKS", "build_network", "load_checkpoint", "load_network", "save_checkpoint"]


@dataclass(frozen=True)
class _Network:
    module: type
    config: type


# The name in checkpoints and manifests -> the classes.
NETWORKS = {
    "arnet": _Network(ARNet, ARNetConfig),
    "iunet": _Network(IUNet, IUNetConfig),
    "repair": _Network(RepairNet, RepairNetConfig),
    "edges": _Network(EdgeNet, EdgeNetConfig),
}


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
    if not isinstance(content, dict) or content.get("name") not in NETWORKS or "network" not in content:
        raise DataFileError(f"{path}: expected a checkpoint of {' or '.join(NETWORKS)}")
    return content


def load_network(path: Path, name: str) -> torch.nn.Module:
    """Return the network called ``name`` from a checkpoint, in evaluation mode."""
    content = load_checkpoint(path)
    if content["name"] != name:
        raise DataFileError(f"{path}: expected a checkpoint of {name}, found one of {content['name']}")
    network = build_network(name, build_config(content["config"], NETWORKS[name].config, str(path)))
    network.load_state_dict(content["network"])
    return network.eval()
