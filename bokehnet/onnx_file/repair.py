"""The network of the disparity repair as ONNX operators: :mod:`bokehnet.depth_repair.stages.network`."""

from pathlib import Path

import numpy as np
import onnx

from bokehnet.depth_repair.config import BLOCK_PX
from bokehnet.depth_repair.stages.network import RepairNetwork
from bokehnet.inference.session import WEIGHTS
from bokehnet.onnx_file.builder import Graph
from bokehnet.onnx_file.pictures import pad_to_multiple
from bokehnet.onnx_session import OnnxSession
from bokehnet.progress import ignore_progress
from bokehnet.version import __version__

__all__ = ["build_repair", "compare_repair"]

# Lower bound of the range of a map, for even maps.
_MIN_SPAN = 1e-12


def build_repair(weights: Path | None = None) -> onnx.ModelProto:
    """Return the network that moves depth edges to those of the picture, as one model.

    Inputs, float32: ``image`` (H, W, 3), scene-linear, and ``disparity`` (H, W), any unit, larger is nearer.
    Output: ``repaired`` (H, W), in the same unit. The diagnosis, the other stages and the acceptance of
    :mod:`bokehnet.depth_repair` are not in the file: a map that is right can lose.

    Args:
        weights: Folder with the network; default: that of the package.
    """
    g = Graph()
    image = g.input("image", np.float32, ["height", "width", 3])
    disparity = g.input("disparity", np.float32, ["height", "width"])
    height, width = disparity.size(0), disparity.size(1)
    colors = pad_to_multiple(g, g.maximum(image, 0).transpose(2, 0, 1), BLOCK_PX)
    padded = pad_to_multiple(g, disparity, BLOCK_PX)
    inputs = {
        "image": g.op("Unsqueeze", colors, g.sizes(0)),
        "disparity": g.op("Unsqueeze", padded, g.sizes(0, 1)),
        "span": g.maximum(disparity.max() - disparity.min(), _MIN_SPAN).reshape(1, 1, 1, 1),
    }
    network = onnx.load((weights or WEIGHTS / "repair") / "repair.onnx")
    repaired = g.op("Squeeze", g.inline(network, inputs)[0], g.sizes(0, 1))
    repaired = repaired.cut(0, 0, height).cut(1, 0, width)
    about = {"producer": f"bokehnet {__version__}", "license": "Apache-2.0", "light": "scene-linear"}
    model = g.model({"repaired": (repaired, ["height", "width"])}, **about)
    onnx.checker.check_model(model, full_check=True)
    return model


def compare_repair(
    model: bytes, weights: Path | None, trials: list[tuple[np.ndarray, np.ndarray]]
) -> list[float]:
    """Return the PSNR in dB between the file and the package's network, one per trial.

    Args:
        model: Content of the file.
        weights: Folder with the network, as for :func:`build_repair`.
        trials: Pictures (H, W, 3) and their disparity (H, W) of a range of about 1.
    """
    session = OnnxSession(model, options={"log_severity_level": 3})
    network, psnrs = RepairNetwork(weights or WEIGHTS / "repair"), []
    for image, disparity in trials:
        repaired = session.run({"image": image, "disparity": disparity})[0]
        expected = network(image.transpose(2, 0, 1), disparity, float(np.ptp(disparity)), ignore_progress)
        psnrs.append(float(-10 * np.log10(np.square(repaired - expected).mean() + 1e-20)))
    return psnrs
