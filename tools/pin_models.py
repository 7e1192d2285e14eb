"""Pin the commit and the hash of each named depth network.

Maintainers run it before a release, with a connection to the hub:

    python -m tools.pin_models [NAME ...] [--check]

For each NAME (default: all of ``bokehnet/inference/depth_models.toml``) the command reads the newest commit
from the hub, checks that the licence matches the table and that the file exists, downloads and hashes it,
compares the hash with that of the hub, and runs the network on a picture by its convention. It writes the
networks that pass to ``depth_model_pins.toml`` and keeps other pins. With ``--check`` it writes nothing, and
the exit code is 1 if a pin differs from the hub at that commit.
"""

import argparse
import hashlib
import sys
import tomllib
from pathlib import Path

import numpy as np

from bokehnet.errors import BokehnetError, ModelFileError
from bokehnet.inference.depth_convention import find_convention
from bokehnet.inference.depth_models import PINS, DepthModel, depth_model_names, find_depth_model
from bokehnet.inference.monocular import DepthEstimator
from bokehnet.io.files.atomic import write_text

_HEAD = """\
# Written by `python -m tools.pin_models`: pinned revision and hash of each network in depth_models.toml.
#
# `attested` says how a pin was found. Where it names public sources, the file was not downloaded for this
# table; `python -m tools.pin_models --check` downloads and runs it. The hash decides in any case: other bytes
# are never run. The revision "main" means that only the hash is pinned.
"""

# Origin of the pins that this command writes.
_ATTESTED = "the hub, and the downloaded file, which ran on a picture"


def pin(model: DepthModel, revision: str | None = None) -> dict[str, str | int]:
    """Return revision, SHA-256 and size of a network's file on the hub.

    Args:
        model: Name, repository, file, licence and convention of the network.
        revision: Commit; None for the newest.

    Raises:
        ModelFileError: The licence has changed, the file is missing, the hash differs from that of the hub,
            or the network does not follow its convention.
    """
    from huggingface_hub import HfApi, hf_hub_download

    info = HfApi().model_info(model.repository, revision=revision, files_metadata=True)
    licence = (info.card_data or {}).get("license")
    if licence is not None and str(licence) != model.licence:
        raise ModelFileError(f"{model.name}: expected the licence {model.licence}, found {licence}")
    files = {item.rfilename: item for item in info.siblings or ()}
    if model.file not in files:
        raise ModelFileError(
            f"{model.name}: expected {model.file} in {model.repository}, found {sorted(files)}"
        )
    assert info.sha is not None
    path = Path(hf_hub_download(model.repository, model.file, revision=info.sha))
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    lfs = files[model.file].lfs
    if lfs is not None and lfs.sha256 != sha256:
        raise ModelFileError(f"{model.name}: expected SHA-256 {lfs.sha256} (hub), found {sha256}")
    ramp = np.broadcast_to(np.linspace(0, 1, 64, dtype=np.float32)[:, None, None], (64, 96, 3))
    DepthEstimator(path, find_convention(model.convention))(np.ascontiguousarray(ramp))
    return {"revision": info.sha, "sha256": sha256, "bytes": path.stat().st_size}


def pins_text(pins: dict[str, dict[str, str | int]]) -> str:
    """Return the text of the file of pins, in the order of the table."""
    tables = []
    for name in (name for name in depth_model_names() if name in pins):
        rows = [f"{key} = {value!r}".replace("'", '"') for key, value in pins[name].items()]
        tables.append("\n".join([f"[{name}]", *rows]))
    return _HEAD + "".join(f"\n{table}\n" for table in tables)


def _check_pin(name: str, expected: dict[str, str | int], pinned: dict[str, str | int]) -> None:
    """Raise ``ModelFileError`` if a pin differs from the hub; the revision "main" stands for any commit."""
    keys = ["sha256", "bytes"] if expected["revision"] == "main" else ["revision", "sha256", "bytes"]
    if any(pinned[key] != expected[key] for key in keys):
        raise ModelFileError(f"{name}: expected {expected}, found {pinned}")


def main(arguments: list[str] | None = None) -> int:
    """Pin the networks of the command line; return 0 if all passed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all published networks")
    parser.add_argument("--check", action="store_true", help="write nothing; compare with the pins")
    options = parser.parse_args(arguments)
    pins, failed = tomllib.loads(PINS.read_text(encoding="utf-8")), 0
    for name in options.names or depth_model_names():
        model = find_depth_model(name)
        try:
            if model is None:
                raise ModelFileError(f"{name}: expected one of {', '.join(depth_model_names())}")
            if model.unpublished:
                print(f"{name}: left out, {model.unpublished}")
                continue
            if options.check and not model.revision:
                raise ModelFileError(f"{name}: not pinned")
            pinned = pin(model, model.revision if options.check else None)
            if options.check:
                _check_pin(name, pins[name], pinned)
        except (BokehnetError, OSError) as error:
            failed += 1
            print(f"{name}: {error}", file=sys.stderr)
            continue
        pins[name] = {**pinned, "attested": _ATTESTED}
        print(f"{name}: {pinned['revision']} {pinned['sha256']} {pinned['bytes']} bytes")
    if not options.check:
        write_text(PINS, pins_text(pins), error=ModelFileError)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
