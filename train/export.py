"""Turn two checkpoints into the ONNX files that inference uses.

``python -m train.export --arnet runs/arnet/last.pt --iunet runs/iunet/last.pt --out bokehnet/weights``
"""

import argparse
import sys
from pathlib import Path

from bokehnet.errors import BokehnetError, ModelFileError
from bokehnet.models.checkpoint import load_checkpoint, load_network
from bokehnet.models.onnx_export import PARITY, export_networks

__all__ = ["main"]


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arnet", required=True, type=Path)
    parser.add_argument("--iunet", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    arguments = parser.parse_args()
    try:
        notes = {}
        for name in ("arnet", "iunet"):
            state = load_checkpoint(getattr(arguments, name))
            notes[name] = {"steps": state["step"], "run": state["run"]}
        arnet, iunet = (load_network(getattr(arguments, name), name) for name in ("arnet", "iunet"))
        bases = {name: note["run"]["data"].get("classical", "scatter") for name, note in notes.items()}
        if bases["arnet"] != bases["iunet"]:
            raise ModelFileError(
                f"both networks must correct one classical renderer, found {bases['arnet']} for ARNet and "
                f"{bases['iunet']} for IUNet; train IUNet again with data.classical = {bases['arnet']!r}"
            )
        differences = export_networks(arnet, iunet, arguments.out, notes, bases["arnet"])
    except BokehnetError as error:
        sys.exit(f"error: {error}")
    for name, difference in differences.items():
        print(f"{name}: largest |torch - ONNX Runtime| {difference:.1e} (limit {PARITY})")


if __name__ == "__main__":
    main()
