"""Networks as ONNX Runtime sessions, verified against their manifest."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.checks import check_choice
from bokehnet.engine_registry import CLASSICAL, ENGINES
from bokehnet.errors import ModelFileError
from bokehnet.inference.process_memory import keeps_freed_memory
from bokehnet.onnx_session import CPU, OnnxSession, load_onnxruntime

__all__ = ["WEIGHTS", "Networks", "OnnxNetwork", "load_network", "load_networks"]

# Shipped networks: a folder per engine with networks, and ``error``.
WEIGHTS = Path(__file__).parent.parent / "weights"

_FORMAT = 1

# Keys of manifests and inputs of networks of earlier versions, and their current names.
_OLD_KEYS = {"unit": "network_max_radius", "trusted_radius": "max_valid_radius"}
_OLD_INPUTS = {"hints": "features"}


class OnnxNetwork:
    """Single network that takes arrays by position and feeds them by name."""

    def __init__(
        self,
        model: bytes,
        input_names: tuple[str, ...],
        threads: int,
        providers: Sequence[str] = CPU,
        options: Any = None,
    ) -> None:
        for provider in () if tuple(providers) == CPU else providers:
            check_choice("provider", provider, load_onnxruntime().get_available_providers())
        if options is None:
            # A memory pattern is allocated as a separate block with the second picture, in addition to the
            # pieces of the first: twice the memory, and half a second more.
            # If the process keeps freed memory, layers and rays share it; an arena would not be shared.
            # Spinning threads take cores from other computations.
            options = {
                "intra_op_num_threads": threads,
                "log_severity_level": 3,
                "enable_mem_pattern": False,
                "enable_cpu_mem_arena": not keeps_freed_memory(),
                "session.intra_op.allow_spinning": "0",
            }
        self._has_pool = not isinstance(options, dict) or options.get("enable_cpu_mem_arena", True)
        self._session = OnnxSession(model, providers, options)
        self._input_names = input_names
        self._model_inputs = {item.name for item in self._session.inputs()}

    @property
    def sees_features(self) -> bool:
        """True if the network receives the features of the classical renderer."""
        return any(_OLD_INPUTS.get(name, name) == "features" for name in self._model_inputs)

    def __call__(self, *arrays: np.ndarray | None, release: bool = False) -> Any:
        """Run on float32 arrays (B, C, H, W) in the order of the input names; return one array or a tuple.

        Arrays that are no inputs of the network are ignored and may be ``None``. ``release`` frees the memory
        of the layers afterwards, which slows down the next run.
        """
        by_name = dict(zip(self._input_names, arrays, strict=True))
        contiguous = {
            key: np.ascontiguousarray(by_name[_OLD_INPUTS.get(key, key)], np.float32)
            for key in self._model_inputs
        }
        results = self._session.run(contiguous, release=release and self._has_pool)
        return results[0] if len(results) == 1 else tuple(results)


@dataclass(frozen=True, kw_only=True, slots=True)
class Networks:
    """Networks of one engine.

    Attributes:
        arnet: ARNet: image, defocus, classical, features to bokeh and error map.
        iunet: IUNet: image, defocus, classical, coarse, features to bokeh; ``None`` if the detail of the
            classical render is kept instead.
        network_max_radius: Largest radius that ``arnet`` was trained for, pixels.
        classical: Name of the classical renderer whose results they correct.
        max_valid_radius: Largest blur radius that they may correct, pixels.
    """

    arnet: OnnxNetwork
    iunet: OnnxNetwork | None
    network_max_radius: float
    classical: str
    max_valid_radius: float = math.inf

    @property
    def leaves_outlines(self) -> bool:
        """True if the classical render has sharp outlines on blurred foregrounds."""
        return CLASSICAL[self.classical].sharp_foregrounds


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / "manifest.json"
    if folder.is_file():
        raise ModelFileError(f"{folder}: expected a folder with manifest.json, found a file")
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelFileError(
            f"network weights missing: cannot read {path}; install the package again, name another folder "
            f"with --weights, or use --engine rays"
        ) from error
    except ValueError as error:
        raise ModelFileError(f"{path}: expected JSON, found an error: {error}") from error
    version = manifest.get("format") if isinstance(manifest, dict) else None
    if version != _FORMAT:
        raise ModelFileError(f"{path}: expected manifest format {_FORMAT}, found {version}; export again")
    return {_OLD_KEYS.get(key, key): value for key, value in manifest.items()}


def _check_pair(folder: Path, manifest: dict[str, Any]) -> None:
    path = folder / "manifest.json"
    if not isinstance(manifest.get("network_max_radius"), int | float):
        raise ModelFileError(f"{path}: expected a number called network_max_radius; export again")
    classical = manifest.get("classical")
    if classical not in CLASSICAL:
        raise ModelFileError(
            f"{path}: expected classical to be one of {', '.join(CLASSICAL)}, found {classical}; export again"
        )
    radius = manifest.get("max_valid_radius", 1)
    if not isinstance(radius, int | float) or not radius > 0:
        raise ModelFileError(
            f"{path}: expected max_valid_radius to be above 0, found {radius!r}; export again"
        )


def _read_model(folder: Path, name: str, manifest: dict[str, Any]) -> bytes:
    try:
        entry = manifest["networks"][name]
        path, expected = folder / entry["file"], entry["sha256"]
    except (KeyError, TypeError) as error:
        raise ModelFileError(
            f"{folder / 'manifest.json'}: expected an entry for {name}; export again"
        ) from error
    try:
        model = path.read_bytes()
    except OSError as error:
        raise ModelFileError(
            f"network weights missing: cannot read {path}; install the package again or use --engine rays"
        ) from error
    digest = hashlib.sha256(model).hexdigest()
    if digest != expected:
        raise ModelFileError(
            f"{path}: expected sha256 {expected[:12]}... by the manifest, found {digest[:12]}...; "
            f"the file is damaged or was replaced, install the package again"
        )
    return model


def load_network(folder: Path, name: str, input_names: tuple[str, ...], threads: int = 0) -> OnnxNetwork:
    """Load one network, verified against its manifest; arguments and errors as in ``load_networks``."""
    return OnnxNetwork(_read_model(folder, name, _read_manifest(folder)), input_names, threads)


def load_networks(
    folder: Path,
    classical: str,
    threads: int = 0,
    providers: Sequence[str] = CPU,
    options: Any = None,
    *,
    refine: bool = True,
) -> Networks:
    """Load ARNet, and IUNet if there is one, verified against their manifest.

    Args:
        folder: Folder with ``manifest.json`` and the ONNX files that it names.
        classical: Name of the classical renderer whose results they have to correct.
        threads: Threads inside a network; 0 uses all cores.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        options: ``onnxruntime.SessionOptions`` to use instead of the default ones.
        refine: True to load IUNet, which is optional.

    Raises:
        ParameterError: A provider is not available in ONNX Runtime.
        ModelFileError: A file is missing, damaged or differs from the manifest, or the networks correct
            another renderer.
    """
    manifest = _read_manifest(folder)
    _check_pair(folder, manifest)
    inputs = ("image", "defocus", "classical")
    settings = (threads, providers, options)
    arnet = OnnxNetwork(_read_model(folder, "arnet", manifest), (*inputs, "features"), *settings)
    iunet = None
    if refine and "iunet" in manifest["networks"]:
        model = _read_model(folder, "iunet", manifest)
        iunet = OnnxNetwork(model, (*inputs, "coarse", "features"), *settings)
    if (corrected := manifest["classical"]) != classical:
        engines = [spec.name for spec in ENGINES.values() if spec.networks and spec.classical == corrected]
        raise ModelFileError(
            f"{folder}: expected networks that correct the {classical}, found networks that correct the "
            f"{corrected}, for --engine {' or '.join(engines)}"
        )
    sees_features = arnet.sees_features or (iunet is not None and iunet.sees_features)
    if sees_features and not CLASSICAL[classical].traces_rays:
        raise ModelFileError(
            f"{folder}: expected networks without the input features, which {classical} does not "
            "provide, found one with it; train it with model.see_features = false and export again"
        )
    return Networks(
        arnet=arnet,
        iunet=iunet,
        network_max_radius=float(manifest["network_max_radius"]),
        classical=classical,
        max_valid_radius=float(manifest.get("max_valid_radius", math.inf)),
    )
