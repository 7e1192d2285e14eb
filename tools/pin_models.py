"""Pin the named depth networks: which commit and which bytes each name stands for.

Run by a maintainer before a release, with a connection to the hub:

    python -m tools.pin_models [NAME ...] [--check]

For each name of ``bokehnet/inference/depth_models.toml`` (or those given) it asks the hub for the newest
commit, sees that the licence is still that of the table and that the file is there, downloads it, hashes it,
compares the hash with the hub's own, and lets it see a picture by its convention. What passes is written to
``depth_model_pins.toml``; pins of others stay. With ``--check`` nothing is written, and the exit code is 1
where a pin is not what the hub has at that commit.
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
from bokehnet.io.atomic import write_text

_HEAD = """\
# Written by `python -m tools.pin_models`: pinned revision and hash of each network in depth_models.toml.
"""


def pin(model: DepthModel, revision: str | None = None) -> dict[str, str | int]:
    """Return revision, SHA-256 and size of a network's file on the hub.

    Args:
        model: Its name, repository, file, licence and convention.
        revision: Commit to look at; None takes the newest.

    Raises:
        ModelFileError: The licence has changed, the file is gone, the hub's hash is another, or the network
            does not do as its convention says.
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
    told = files[model.file].lfs
    if told is not None and told.sha256 != sha256:
        raise ModelFileError(f"{model.name}: the hub tells SHA-256 {told.sha256}, its bytes have {sha256}")
    ramp = np.broadcast_to(np.linspace(0, 1, 64, dtype=np.float32)[:, None, None], (64, 96, 3))
    DepthEstimator(path, find_convention(model.convention))(np.ascontiguousarray(ramp))
    return {"revision": info.sha, "sha256": sha256, "bytes": path.stat().st_size}


def pins_text(pins: dict[str, dict[str, str | int]]) -> str:
    """The file of pins, in the order of the table."""
    tables = []
    for name in (name for name in depth_model_names() if name in pins):
        rows = [f"{key} = {value!r}".replace("'", '"') for key, value in pins[name].items()]
        tables.append("\n".join([f"[{name}]", *rows]))
    return _HEAD + "".join(f"\n{table}\n" for table in tables)


def main(arguments: list[str] | None = None) -> int:
    """Pin what the command line names; 0 where all went well."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all that are published")
    parser.add_argument("--check", action="store_true", help="write nothing; compare with what is pinned")
    given = parser.parse_args(arguments)
    pins, failed = tomllib.loads(PINS.read_text(encoding="utf-8")), 0
    for name in given.names or depth_model_names():
        model = find_depth_model(name)
        try:
            if model is None:
                raise ModelFileError(f"{name}: expected one of {', '.join(depth_model_names())}")
            if model.unpublished:
                print(f"{name}: left out, {model.unpublished}")
                continue
            if given.check and not model.revision:
                raise ModelFileError(f"{name}: not pinned")
            found = pin(model, model.revision if given.check else None)
            if given.check and found != pins[name]:
                raise ModelFileError(f"{name}: expected {pins[name]}, found {found}")
        except (BokehnetError, OSError) as error:
            failed += 1
            print(f"{name}: {error}", file=sys.stderr)
            continue
        pins[name] = found
        print(f"{name}: {found['revision']} {found['sha256']} {found['bytes']} bytes")
    if not given.check:
        write_text(PINS, pins_text(pins), error=ModelFileError)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
