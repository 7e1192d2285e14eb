"""Shards: tar files in the WebDataset layout, one ``{index:08d}.npz`` per sample.

The bytes of a shard depend only on its samples: no times, no owners.
"""

import io
import json
import tarfile
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import BinaryIO

import numpy as np

from bokehnet.errors import DataFileError

__all__ = [
    "DESCRIPTION",
    "ShardSet",
    "TrainingSample",
    "decode_sample",
    "encode_sample",
    "read_sample",
    "shard_name",
    "write_members",
]

DESCRIPTION = "dataset.json"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TrainingSample:
    """Sample of one scene; ``blur[v] * (disparity - focus[v])`` is the blur radius of view v in pixels.

    Attributes:
        image: All-in-focus picture, scene-linear, (H, W, 3) float16.
        disparity: Relative inverse depth in [0, 1], 0 = infinitely far, (H, W) float32.
        fine_disparity: Relative inverse depth at the pixel centres of a finer grid, (k H, k W) float16; k may
            be 0.
        bokeh: True picture of each view, scene-linear, (V, H, W, 3) float16.
        blur: Blur radius per unit of disparity, pixels, (V,) float32.
        focus: Relative disparity in focus, (V,) float32.
    """

    image: np.ndarray
    disparity: np.ndarray
    fine_disparity: np.ndarray
    bokeh: np.ndarray
    blur: np.ndarray
    focus: np.ndarray


def shard_name(number: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{number:06d}.tar"


def encode_sample(sample: TrainingSample) -> bytes:
    """Return ``sample`` as the bytes of an npz file, uncompressed because noise does not compress."""
    buffer = io.BytesIO()
    np.savez(buffer, **{item.name: getattr(sample, item.name) for item in fields(TrainingSample)})
    return buffer.getvalue()


def decode_sample(data: bytes, source: str = "sample") -> TrainingSample:
    """Return the sample of bytes from :func:`encode_sample`.

    Raises:
        DataFileError: The bytes are damaged; ``source`` names them.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            damaged = archive.testzip()  # np.load would parse wrong bytes before their checksum
        if damaged is not None:
            raise ValueError(f"wrong checksum of {damaged}")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            sample = TrainingSample(**{item.name: arrays[item.name] for item in fields(TrainingSample)})
        _check_shapes(sample)
        return sample
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, NotImplementedError) as error:
        raise DataFileError(
            f"{source}: expected a training sample, found damaged or other data: {error}"
        ) from error


def _check_shapes(sample: TrainingSample) -> None:
    """Raise ``ValueError`` unless the shapes of a sample's arrays agree."""
    size, views = sample.disparity.shape, sample.blur.shape
    expected = {"image": (*size, 3), "bokeh": (*views, *size, 3), "focus": views}
    for name, shape in expected.items():
        actual = getattr(sample, name).shape
        if len(size) != 2 or len(views) != 1 or actual != shape:
            raise ValueError(f"{name} of shape {actual} with disparity of shape {size} and {views} views")


def write_members(stream: BinaryIO, members: Iterable[tuple[str, bytes]]) -> None:
    """Write (name, bytes) pairs as a tar file."""
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name, data in members:
            header = tarfile.TarInfo(name)  # time 0, no owner
            header.size = len(data)
            archive.addfile(header, io.BytesIO(data))


def read_sample(shard: str | Path, key: str) -> TrainingSample:
    """Read the sample ``key`` (the name of its member without ``.npz``) of one shard.

    Raises:
        DataFileError: The shard is missing or damaged, or has no such sample.
    """
    members = _index(Path(shard))
    if key not in members:
        raise DataFileError(f"{shard}: no sample {key!r}; it has {', '.join(sorted(members)) or 'none'}")
    return _read(Path(shard), key, *members[key])


class ShardSet:
    """Samples of a folder, by index; reads one sample at a time; picklable.

    Args:
        folder: Folder that ``bokehnet synth`` wrote.
        allow_incomplete: Accept a set with missing shards.
        on_damage: Called with the error of an unreadable shard, which is then skipped; default: raise it.

    Raises:
        DataFileError: The folder holds no shards, or one is damaged or missing.
    """

    def __init__(
        self,
        folder: str | Path,
        allow_incomplete: bool = False,
        on_damage: Callable[[DataFileError], None] | None = None,
    ) -> None:
        self.folder = Path(folder)
        description = self.folder / DESCRIPTION
        try:
            self.description: dict = json.loads(description.read_text(encoding="utf-8"))
            expected = int(self.description["scenes"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DataFileError(f"{description}: expected the description of a data set: {error}") from error
        self._members: list[tuple[Path, str, int, int]] = []
        for path in sorted(self.folder.glob("shard-*.tar")):
            try:
                index = _index(path)
            except DataFileError as error:
                if on_damage is None:
                    raise
                on_damage(error)
                expected -= int(self.description.get("scenes_per_shard", expected))
                continue
            self._members += [(path, key, offset, size) for key, (offset, size) in index.items()]
        if not self._members or (len(self._members) < expected and not allow_incomplete):
            available = f"{len(self._members)} of {expected} samples"
            raise DataFileError(f"{self.folder}: found {available}; run bokehnet synth again to complete it")

    def __len__(self) -> int:
        return len(self._members)

    def __getitem__(self, number: int) -> TrainingSample:
        """Read sample ``number``; IndexError outside the set."""
        return _read(*self._members[number])


def _index(shard: Path) -> dict[str, tuple[int, int]]:
    """Return the offset and size of every sample of a shard."""
    try:
        with tarfile.open(shard, "r:") as archive:
            return {Path(item.name).stem: (item.offset_data, item.size) for item in archive if item.isfile()}
    except (OSError, tarfile.TarError) as error:
        raise DataFileError(f"{shard}: expected a shard of training samples: {error}") from error


def _read(shard: Path, key: str, offset: int, size: int) -> TrainingSample:
    try:
        with open(shard, "rb") as stream:
            stream.seek(offset)
            data = stream.read(size)
    except OSError as error:
        raise DataFileError(f"cannot read shard {shard}: {error.strerror or error}") from error
    return decode_sample(data, f"{shard}, sample {key}")
