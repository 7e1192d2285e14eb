"""The networks as ONNX Runtime sessions, used only when they are what the manifest says."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.checks import check_choice
from bokehnet.engine_registry import CLASSICAL
from bokehnet.errors import ModelFileError
from bokehnet.inference.process_memory import keeps_freed
from bokehnet.onnx_session import CPU, OnnxSession, load_onnxruntime

__all__ = ["WEIGHTS", "Networks", "OnnxNetwork", "load_network", "load_networks"]

# What ships with the package: a folder for each engine with networks, and ``repair``.
WEIGHTS = Path(__file__).parent.parent / "weights"

_FORMAT = 1

# What earlier versions called keys of a manifest and inputs of a network.
_OLD_KEYS = {"unit": "network_max_radius", "trusted_radius": "max_valid_radius"}
_OLD_INPUTS = {"hints": "features"}


class OnnxNetwork:
    """One network; arrays go in by position and are fed by name."""

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
            # A plan for one size comes as a block of its own with the second picture, on top of the first
            # one's pieces: twice the memory, and half a second more until it is there.
            # Where the process keeps what it frees, layers and rays share it; a pool would be theirs alone.
            # Threads that wait for work without sleeping take the cores of whatever else computes.
            options = {
                "intra_op_num_threads": threads,
                "log_severity_level": 3,
                "enable_mem_pattern": False,
                "enable_cpu_mem_arena": not keeps_freed(),
                "session.intra_op.allow_spinning": "0",
            }
        self._has_pool = not isinstance(options, dict) or options.get("enable_cpu_mem_arena", True)
        self._session = OnnxSession(model, providers, options)
        self._input_names = input_names
        self._taken = {item.name for item in self._session.inputs()}

    def __call__(self, *arrays: np.ndarray | None, release: bool = False) -> Any:
        """Run on float32 arrays (B, C, H, W), in the order of the input names; one array or a tuple back.

        Inputs that the network does not take are left out and may be ``None``. ``release`` gives the memory
        of the layers back afterwards, which costs time when the network runs again.
        """
        fed = dict(zip(self._input_names, arrays, strict=True))
        contiguous = {
            key: np.ascontiguousarray(fed[_OLD_INPUTS.get(key, key)], np.float32) for key in self._taken
        }
        results = self._session.run(contiguous, release=release and self._has_pool)
        return results[0] if len(results) == 1 else tuple(results)


@dataclass(frozen=True, kw_only=True, slots=True)
class Networks:
    """Networks that belong together.

    Attributes:
        arnet: Takes image, defocus, classical, features; gives bokeh and error map.
        iunet: Takes image, defocus, classical, coarse, features; gives bokeh. ``None`` where the classical
            render's detail is carried over instead.
        network_max_radius: Largest radius that ``arnet`` was trained for, pixels.
        classical: Name of the classical renderer whose result they correct.
        max_valid_radius: Largest blur radius that they may correct, pixels.
    """

    arnet: OnnxNetwork
    iunet: OnnxNetwork | None
    network_max_radius: float
    classical: str
    max_valid_radius: float = math.inf

    @property
    def leaves_outlines(self) -> bool:
        """Whether what they correct has outlines in front of focus that it should not have."""
        return CLASSICAL[self.classical].sharp_foregrounds


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / "manifest.json"
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelFileError(
            f"network weights missing: cannot read {path}; install the package again, name another folder "
            f"with --weights, or use --engine rays"
        ) from error
    except ValueError as error:
        raise ModelFileError(f"{path}: expected JSON, found an error: {error}") from error
    found = manifest.get("format") if isinstance(manifest, dict) else None
    if found != _FORMAT:
        raise ModelFileError(f"{path}: expected manifest format {_FORMAT}, found {found}; export again")
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
    trusted = manifest.get("max_valid_radius", 1)
    if not isinstance(trusted, int | float) or not trusted > 0:
        raise ModelFileError(
            f"{path}: expected max_valid_radius to be above 0, found {trusted!r}; export again"
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
    found = hashlib.sha256(model).hexdigest()
    if found != expected:
        raise ModelFileError(
            f"{path}: expected sha256 {expected[:12]}... by the manifest, found {found[:12]}...; "
            f"the file is damaged or was exchanged, install the package again"
        )
    return model


def load_network(folder: Path, name: str, input_names: tuple[str, ...], threads: int = 0) -> OnnxNetwork:
    """Load one network after checking it against its manifest; arguments and errors of ``load_networks``."""
    return OnnxNetwork(_read_model(folder, name, _read_manifest(folder)), input_names, threads)


def load_networks(
    folder: Path,
    threads: int = 0,
    providers: Sequence[str] = CPU,
    options: Any = None,
    *,
    refine: bool = True,
) -> Networks:
    """Load ARNet, and IUNet if there is one, after checking them against their manifest.

    Args:
        folder: Holds ``manifest.json`` and the ONNX files it names.
        threads: Threads inside a network; 0 takes all cores.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        options: ``onnxruntime.SessionOptions`` in place of our own.
        refine: Whether to load IUNet; ARNet does without it.

    Raises:
        ParameterError: A provider that ONNX Runtime does not have here.
        ModelFileError: A file is missing, damaged or not what the manifest says.
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
    return Networks(
        arnet=arnet,
        iunet=iunet,
        network_max_radius=float(manifest["network_max_radius"]),
        classical=manifest["classical"],
        max_valid_radius=float(manifest.get("max_valid_radius", math.inf)),
    )
