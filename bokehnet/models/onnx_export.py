"""From checkpoints to the ONNX files that inference uses, with a proof that they compute the same."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor, nn

from bokehnet.config import to_dict
from bokehnet.errors import ModelFileError
from bokehnet.io.atomic import write_atomic, write_text
from bokehnet.models.arnet import ARNet
from bokehnet.models.iunet import IUNet

__all__ = ["PARITY", "export_networks"]

# Largest |torch - ONNX Runtime| that an export may show, on pictures with values in [0, 1].
PARITY = 1e-4

_EXAMPLE_SIZE = (48, 64)
_OTHER_SIZES = ((32, 80), (70, 46))


def _inputs(name: str, size: tuple[int, int], unit: float) -> dict[str, Tensor]:
    """Random inputs of one network, by name."""
    generator = torch.Generator().manual_seed(size[0])
    height, width = size
    inputs = {
        "image": torch.rand(1, 3, height, width, generator=generator),
        "defocus": unit * (2 * torch.rand(1, 1, height, width, generator=generator) - 1),
        "classical": torch.rand(1, 3, height, width, generator=generator),
    }
    if name == "iunet":
        inputs["coarse"] = torch.rand(1, 3, height // 2, width // 2, generator=generator)
    return inputs


def _export(network: nn.Module, name: str, unit: float, path: Path) -> None:
    """Write one network with dynamic height and width (both even)."""
    inputs = _inputs(name, _EXAMPLE_SIZE, unit)
    rows, columns = torch.export.Dim("half_height", min=2), torch.export.Dim("half_width", min=2)
    sizes: dict[str, Any] = {key: {2: 2 * rows, 3: 2 * columns} for key in inputs}
    if "coarse" in sizes:
        sizes["coarse"] = {2: rows, 3: columns}
    program = torch.onnx.export(
        network,
        tuple(inputs.values()),
        dynamo=True,
        input_names=list(inputs),
        output_names=["bokeh", "error_map"] if name == "arnet" else ["bokeh"],
        dynamic_shapes=tuple(sizes.values()),
        verbose=False,
    )
    assert program is not None
    onnx.save(_without_traces(program.model_proto), path)


def _without_traces(model: onnx.ModelProto) -> onnx.ModelProto:
    """Remove where in the source each node came from: it names files of the machine that exported."""
    del model.graph.metadata_props[:]
    for node in model.graph.node:
        del node.metadata_props[:]
        node.ClearField("doc_string")
    return model


def _largest_difference(network: nn.Module, name: str, unit: float, path: Path) -> float:
    """Compare ONNX Runtime with torch at sizes other than the exported example's."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    taken = {item.name for item in session.get_inputs()}
    largest = 0.0
    for size in _OTHER_SIZES:
        inputs = _inputs(name, size, unit)
        with torch.no_grad():
            wanted = network(*inputs.values())
        got = session.run(None, {key: x.numpy() for key, x in inputs.items() if key in taken})
        for a, b in zip(wanted if isinstance(wanted, tuple) else (wanted,), got, strict=True):
            largest = max(largest, float(np.abs(a.numpy() - b).max()))
    return largest


def export_networks(
    arnet: ARNet, iunet: IUNet, folder: Path, notes: dict[str, Any], classical: str = "scatter"
) -> dict[str, float]:
    """Write ``arnet.onnx``, ``iunet.onnx`` and ``manifest.json`` into ``folder``.

    Args:
        arnet: Trained ARNet.
        iunet: Trained IUNet with the same unit.
        folder: Target; made if absent. The manifest comes last, so that a broken export is never used.
        notes: How the networks were made; kept in the manifest.
        classical: Name of the classical renderer whose result they correct.

    Returns:
        Largest difference between torch and ONNX Runtime for each network.

    Raises:
        ModelFileError: The units differ, or a difference exceeds ``PARITY``; the manifest is not written.
    """
    networks: dict[str, ARNet | IUNet] = {"arnet": arnet, "iunet": iunet}
    unit = arnet.config.unit
    if unit != iunet.config.unit:
        raise ModelFileError(
            f"both networks must share one unit, got {unit} and {iunet.config.unit}; "
            f"train IUNet behind this ARNet"
        )
    folder.mkdir(parents=True, exist_ok=True)
    entries, differences = {}, {}
    for name, network in networks.items():
        network.eval()
        path = folder / f"{name}.onnx"

        def write(temporary: Path, name: str = name, network: ARNet | IUNet = network) -> None:
            _export(network, name, unit, temporary)
            differences[name] = _largest_difference(network, name, unit, temporary)
            if differences[name] > PARITY:
                raise ModelFileError(
                    f"{name}: expected ONNX Runtime and torch to agree to {PARITY}, "
                    f"they differ by {differences[name]:.1e}"
                )

        write_atomic(path, write, error=ModelFileError)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        entries[name] = {"file": path.name, "sha256": digest, "config": to_dict(network.config)}
    manifest = {"format": 1, "unit": unit, "classical": classical, "networks": entries, "notes": notes}
    write_text(folder / "manifest.json", json.dumps(manifest, indent=2) + "\n", error=ModelFileError)
    return differences
