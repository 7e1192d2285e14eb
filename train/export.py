"""Export checkpoints to the ONNX files that inference uses.

``python -m train.export --arnet runs/arnet/last.pt [--iunet LAST.pt] --out bokehnet/weights/hybrid``
``python -m train.export --error runs/error/last.pt --out bokehnet/weights/error``
``python -m train.export --light runs/light/last.pt --out runs/light/onnx``
``python -m train.export --bokehme-arnet LAST.pt --bokehme-iunet LAST.pt --out bokehnet/weights/bokehme``
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bokehnet.checks import check_at_least
from bokehnet.errors import BokehnetError, DataFileError, ModelFileError
from bokehnet.models.checkpoint import load_checkpoint, load_network
from bokehnet.models.onnx_export import PARITY, export_networks
from train.data.prepared import DESCRIPTION, check_features

__all__ = ["main"]

_NETWORKS = ("arnet", "iunet", "error", "light", "bokehme_arnet", "bokehme_iunet")

# Sets of networks that one export can hold.
_SETS = (
    ["arnet"],
    ["arnet", "iunet"],
    ["error"],
    ["light"],
    ["bokehme_arnet", "bokehme_iunet"],
)


def _note(path: Path, state: dict[str, Any]) -> dict[str, Any]:
    """Return the number of steps and the configuration stored in a checkpoint."""
    if not {"step", "run"} <= state.keys():
        raise DataFileError(f"{path}: expected the checkpoint of a run, found only weights; train again")
    return {"steps": state["step"], "run": state["run"]}


def _classical_of(run: dict[str, Any]) -> str:
    """Return the classical renderer whose result a run's networks correct."""
    path = Path(DESCRIPTION)
    try:
        path = Path(run["data"]["folder"]) / DESCRIPTION
        return str(json.loads(path.read_text(encoding="utf-8"))["config"]["classical"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataFileError(
            f"{path}: expected the description of the network's training data ({error})"
        ) from error


def main(words: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name in _NETWORKS:
        option = name.replace("_", "-")
        parser.add_argument(f"--{option}", type=Path)
    parser.add_argument(
        "--max-valid-radius",
        "--trusted-radius",  # name in earlier versions
        type=float,
        help="largest blur that ARNet may correct, pixels",
    )
    parser.add_argument("--out", required=True, type=Path)
    arguments = parser.parse_args(words)
    names = [name for name in _NETWORKS if getattr(arguments, name)]
    if names not in _SETS:
        parser.error(
            "expected --arnet, with or without --iunet, --error, --light, or both of "
            "--bokehme-arnet and --bokehme-iunet"
        )
    try:
        states = {name: load_checkpoint(getattr(arguments, name)) for name in names}
        notes = {name: _note(getattr(arguments, name), state) for name, state in states.items()}
        networks = {name: load_network(getattr(arguments, name), name) for name in names}
        manifest: dict[str, Any] = {"notes": notes}
        if "arnet" in networks:
            renderers = {name: _classical_of(note["run"]) for name, note in notes.items()}
            if renderers["arnet"] != renderers.get("iunet", renderers["arnet"]):
                raise ModelFileError(
                    f"both networks must correct one classical renderer, found {renderers['arnet']} for "
                    f"ARNet and {renderers['iunet']} for IUNet; train IUNet again on examples of "
                    f"{renderers['arnet']}"
                )
            manifest["classical"] = renderers["arnet"]
            for network in networks.values():
                check_features(network.config.see_features, renderers["arnet"])
            if arguments.max_valid_radius is not None:
                check_at_least("--max-valid-radius", arguments.max_valid_radius, 1)
                manifest["max_valid_radius"] = arguments.max_valid_radius
        differences = export_networks(networks, arguments.out, manifest)
    except BokehnetError as error:
        sys.exit(f"error: {' '.join(str(error).split())}")
    for name, difference in differences.items():
        print(f"{name}: largest |torch - ONNX Runtime| {difference:.1e} (limit {PARITY})")


if __name__ == "__main__":
    main()
