"""Export of networks to ONNX files, with a parity check against torch."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from bokehnet.config import to_dict
from bokehnet.errors import ModelFileError
from bokehnet.inference.bokehme import UNIT_PX
from bokehnet.io.files.atomic import write_atomic, write_text
from bokehnet.models.arnet import ARNet
from bokehnet.models.blocks import UNet
from bokehnet.models.bokehme import BokehMeARNet, BokehMeIUNet
from bokehnet.models.error import FEATURES, ErrorNet
from bokehnet.models.iunet import IUNet
from bokehnet.models.light import FEATURES as LIGHT_FEATURES
from bokehnet.models.light import LightNet
from bokehnet.onnx_session import OnnxSession

__all__ = ["PARITY", "export_networks"]

# Maximum |torch - ONNX Runtime| of an export, on pictures with values in [0, 1].
PARITY = 1e-4

# Heights and widths in blocks of the exported example and of the comparisons.
_EXAMPLE_SIZE = (6, 8)
_COMPARISON_SIZES = ((4, 10), (9, 5))


def _block(network: nn.Module) -> int:
    """Return the divisor of heights and widths: each backbone halves once, a U-Net three times."""
    return 8 if any(isinstance(module, UNet) for module in network.modules()) else 2


def _inputs(network: nn.Module, size: tuple[int, int]) -> dict[str, Tensor]:
    """Return random inputs of a network by name, in the order of its arguments."""
    generator = torch.Generator().manual_seed(size[0])
    height, width = (_block(network) * side for side in size)

    def noise(channels: int, rows: int = height, columns: int = width) -> Tensor:
        return torch.rand(1, channels, rows, columns, generator=generator)

    if isinstance(network, ErrorNet):
        pictures = {name: noise(3) for name in ("image", "rays", "scatter")}
        return {**pictures, "features": noise(len(FEATURES))}
    if isinstance(network, LightNet):
        return {"features": torch.randn(size[0], LIGHT_FEATURES, generator=generator)}
    if isinstance(network, BokehMeARNet | BokehMeIUNet):
        inputs = {"image": noise(3), "defocus": UNIT_PX * (2 * noise(1) - 1)}
        if isinstance(network, BokehMeIUNet):
            inputs["coarse"] = noise(3, height // 2, width // 2)
        return inputs | {"gamma": noise(1, 1, 1)}
    assert isinstance(network, ARNet | IUNet)
    config = network.config
    inputs = {
        "image": noise(3),
        "defocus": config.network_max_radius * (2 * noise(1) - 1),
        "classical": noise(3),
    }
    if isinstance(network, IUNet):
        inputs["coarse"] = noise(3, height // 2, width // 2)
    if config.see_features:
        inputs["features"] = noise(5)
    return inputs


def _export(network: nn.Module, path: Path) -> None:
    """Write one network with dynamic height and width, or number of regions."""
    inputs, block = _inputs(network, _EXAMPLE_SIZE), _block(network)
    rows, columns = torch.export.Dim("rows", min=2), torch.export.Dim("columns", min=2)
    sizes: dict[str, Any] = {key: {2: block * rows, 3: block * columns} for key in inputs}
    if isinstance(network, LightNet):
        sizes = {"features": {0: torch.export.Dim("regions", min=2)}}
    if "coarse" in sizes:
        sizes["coarse"] = {2: block // 2 * rows, 3: block // 2 * columns}
    if "gamma" in sizes:
        sizes["gamma"] = {}
    outputs = {
        "ARNet": ["bokeh", "error_map"],
        "IUNet": ["bokeh"],
        "ErrorNet": ["expected_error"],
        "LightNet": ["log_gain", "probability"],
        "BokehMeARNet": ["bokeh", "error_map"],
        "BokehMeIUNet": ["bokeh"],
    }
    program = torch.onnx.export(
        network,
        tuple(inputs.values()),
        dynamo=True,
        input_names=list(inputs),
        output_names=outputs[type(network).__name__],
        dynamic_shapes=tuple(sizes.values()),
        verbose=False,
    )
    assert program is not None
    onnx.save(_without_source_locations(program.model_proto), path)


def _without_source_locations(model: onnx.ModelProto) -> onnx.ModelProto:
    """Remove the source locations of nodes, which name files of the exporting machine."""
    del model.graph.metadata_props[:]
    for node in model.graph.node:
        del node.metadata_props[:]
        node.ClearField("doc_string")
    return model


def _largest_difference(network: nn.Module, path: Path) -> float:
    """Return the maximum difference between ONNX Runtime and torch at other sizes than the exported one."""
    session = OnnxSession(str(path))
    input_names = {item.name for item in session.inputs()}
    largest = 0.0
    for size in _COMPARISON_SIZES:
        inputs = _inputs(network, size)
        with torch.no_grad():
            expected = network(*inputs.values())
        outputs = session.run({key: x.numpy() for key, x in inputs.items() if key in input_names})
        for a, b in zip(expected if isinstance(expected, tuple) else (expected,), outputs, strict=True):
            largest = max(largest, float(np.abs(a.numpy() - b).max()))
    return largest


def export_networks(
    networks: Mapping[str, nn.Module], folder: Path, manifest: Mapping[str, Any]
) -> dict[str, float]:
    """Write ``NAME.onnx`` for each network, and ``manifest.json``, into ``folder``.

    Args:
        networks: Trained networks by name: ``error``, ``light``, ``bokehme_arnet`` and
            ``bokehme_iunet``, or ``arnet`` and ``iunet`` with the same ``network_max_radius``.
        folder: Target folder; created if missing. The manifest is written last, so that a broken export is
            never used.
        manifest: Further content of the manifest: the runs of the networks, and for a pair the name of the
            classical renderer whose result they correct, as ``classical``.

    Returns:
        Maximum difference between torch and ONNX Runtime for each network.

    Raises:
        ModelFileError: The radii differ, or a difference exceeds ``PARITY``; the manifest is not written.
    """
    radii = {
        name: x.config.network_max_radius for name, x in networks.items() if isinstance(x, ARNet | IUNet)
    }
    if len(set(radii.values())) > 1:
        raise ModelFileError(
            f"both networks must share one network_max_radius, got {radii['arnet']} and {radii['iunet']}; "
            f"train IUNet behind this ARNet"
        )
    folder.mkdir(parents=True, exist_ok=True)
    entries, differences = {}, {}
    for name, network in networks.items():
        network.eval()
        path = folder / f"{name}.onnx"

        def write(temporary: Path, name: str = name, network: nn.Module = network) -> None:
            _export(network, temporary)
            differences[name] = _largest_difference(network, temporary)
            if differences[name] > PARITY:
                raise ModelFileError(
                    f"{name}: expected ONNX Runtime and torch to agree to {PARITY}, "
                    f"they differ by {differences[name]:.1e}"
                )

        write_atomic(path, write, error=ModelFileError)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        entries[name] = {"file": path.name, "sha256": digest, "config": to_dict(network.config)}
    radius = {"network_max_radius": radii["arnet"]} if "arnet" in radii else {}
    content = {"format": 1, **radius, **manifest, "networks": entries}
    write_text(folder / "manifest.json", json.dumps(content, indent=2) + "\n", error=ModelFileError)
    return differences
