"""Import of weights from exported ONNX files, so that training can start from them."""

import hashlib
import json
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import Tensor

from bokehnet.errors import ModelFileError

__all__ = ["read_exported"]


def read_exported(folder: Path, name: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Return configuration and weights, by their torch names, of an exported network.

    The weights include other constants of the graph. An untrained network may lack some weights, as equal
    weights share one name.

    Args:
        folder: Folder that ``bokehnet.models.onnx_export.export_networks`` wrote.
        name: Name of the network, such as ``arnet``.

    Raises:
        ModelFileError: There is no such network, or it does not match the manifest.
    """
    path = folder / "manifest.json"
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))["networks"][name]
        config, file, digest = entry["config"], folder / entry["file"], entry["sha256"]
        data = file.read_bytes()
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelFileError(f"{path}: expected an exported {name} ({error}); export it again") from error
    if hashlib.sha256(data).hexdigest() != digest:
        raise ModelFileError(f"{file}: expected the file that {path} names, found another; export it again")
    constants = onnx.load_model_from_string(data).graph.initializer
    return config, {x.name: torch.from_numpy(onnx.numpy_helper.to_array(x).copy()) for x in constants}
