"""The OpenEXR package against this project's readers of headers and deep samples, and its splicing.

    pytest --all -q tests/unit/io --basetemp=CORPUS
    python -m benchmarks.experiments.programs.exr_library CORPUS [MORE...] [--damaged 3]

Needs ``pip install OpenEXR``. Takes every ``.exr`` file below the folders, each in a process of its own, and
``--damaged`` copies of each with ten random bytes exchanged or the end cut off. Then a file of 24 megapixels
with two parts, and a deep file of one megapixel with up to three samples per pixel.
"""

import argparse
import hashlib
import multiprocessing
import resource
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from bokehnet.io.exr.header import ExrHeaders, read_headers
from bokehnet.io.exr_splice import write_replaced
from bokehnet.io.pixels import ImageFile, Part

_LIMIT_S = 120.0
_MAX_MEMORY_BYTES = 6 * 2**30
_IGNORED = ("compression", "lineOrder", "tiles", "channels", "chunkCount")


def read_ours(path: Path) -> dict[str, Any]:
    """Read all headers, and count the samples of deep parts."""
    headers = read_headers(path)
    deep = 0
    with ImageFile(path) as file:
        for part in file.parts:
            if part.deep:
                deep += int(file.read_deep(part, ()).counts.sum())
    return {"deep": deep, "attributes": sum(len(attributes) for attributes in headers.parts)}


def read_theirs(path: Path) -> dict[str, Any]:
    """Read a file by the package, which offers headers alone or everything."""
    import OpenEXR

    file = OpenEXR.File(str(path), separate_channels=True)
    deep = 0
    for part in file.parts:
        if part.type() in (OpenEXR.deepscanline, OpenEXR.deeptile):
            pixels = next(iter(part.channels.values())).pixels
            deep += sum(0 if samples is None else len(samples) for samples in pixels.reshape(-1))
    return {"deep": deep, "attributes": sum(len(part.header) for part in file.parts)}


def splice_ours(path: Path, target: Path, part: Part, name: str, values: np.ndarray) -> None:
    """Replace a channel by this project's splicing."""
    with ImageFile(path) as source:
        write_replaced(target, source, part, {name: values})


def splice_theirs(path: Path, target: Path, part: Part, name: str, values: np.ndarray) -> None:
    """Replace a channel by reading and writing everything."""
    import OpenEXR

    file = OpenEXR.File(str(path), separate_channels=True)
    channel = file.parts[part.index].channels[name]
    channel.pixels = np.ascontiguousarray(values.astype(channel.pixels.dtype))
    file.write(str(target))


def differences(path: Path, target: Path, part: Part, name: str) -> list[str]:
    """Return what a spliced file does not keep."""
    old, new = read_headers(path), read_headers(target)
    lost = []
    if len(old.parts) != len(new.parts):
        return ["parts"]
    for number, (before, after) in enumerate(zip(old.parts, new.parts, strict=True)):
        ignored = _IGNORED if number == part.index else ()
        if any(after.get(key) != value for key, value in before.items() if key not in ignored):
            lost.append("attributes")
        if any(key not in before for key in after if key not in (*_IGNORED, "type", "version", "name")):
            lost.append("attributes added")
    if chunk_digests(path, old, part.index) != chunk_digests(target, new, part.index):
        lost.append("bytes of other parts")
    with ImageFile(path) as first, ImageFile(target) as second:
        for rows in first.bands(part):
            before = first.read_stored(part, rows).view(np.uint32)
            after = second.read_stored(second.parts[part.index], rows).view(np.uint32)
            kept = [part.channels.index(other) for other in part.channels if other != name]
            if (before[..., kept] != after[..., kept]).any():
                lost.append("bits of other channels")
                break
    return sorted(set(lost))


def chunk_digests(path: Path, headers: ExrHeaders, replaced: int) -> set[str]:
    """Return digests of the bytes after each chunk's part number, of all parts but one."""
    if not headers.multi_part:
        return set()
    data = path.read_bytes()
    counts = [int.from_bytes(attributes["chunkCount"].data, "little") for attributes in headers.parts]
    offsets = np.frombuffer(data, "<u8", sum(counts), headers.end).tolist()
    ends = dict(zip(sorted(offsets), [*sorted(offsets)[1:], len(data)], strict=True))
    owners = np.repeat(np.arange(len(counts)), counts).tolist()
    return {
        f"{owner} {hashlib.sha256(data[offset + 4 : ends[offset]]).hexdigest()}"
        for offset, owner in zip(offsets, owners, strict=True)
        if owner != replaced
    }


def spliced(path: Path, splice: Callable[..., None]) -> dict[str, Any]:
    """Splice a channel of the first part that can be written, and compare."""
    with ImageFile(path) as file:
        places = [
            (part, name)
            for part in file.parts
            for name, kind in zip(part.channels, part.formats, strict=True)
            if not part.deep and kind in ("half", "float")
        ]
        if not places:
            return {"skipped": True}
        part, name = places[0]
        values = file.read(part, [name])[..., 0] * np.float32(0.5)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "spliced.exr")
        splice(path, target, part, name, values)
        return {"lost": differences(path, target, part, name)}


def _child(connection: Any, function: Callable[..., dict[str, Any]], arguments: tuple[Any, ...]) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY_BYTES, _MAX_MEMORY_BYTES))
    try:
        result = function(*arguments)
    except MemoryError:
        result = {"refused": "out of memory"}
    except Exception as problem:
        result = {"refused": str(problem)}
    usage = resource.getrusage(resource.RUSAGE_SELF)
    connection.send({**result, "peak": usage.ru_maxrss / 1024, "seconds": usage.ru_utime + usage.ru_stime})


def run(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Run a function in a process of its own; a crash and a timeout are results."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(sender, function, arguments))
    process.start()
    sender.close()
    try:
        result = receiver.recv() if receiver.poll(_LIMIT_S) else {"killed": "time limit"}
    except EOFError:
        process.join()
        result = {"killed": f"signal {-(process.exitcode or 0)}"}
    process.kill()
    process.join()
    return result


def outcome(result: dict[str, Any]) -> str:
    """Return one word for a result."""
    if "killed" in result:
        return str(result["killed"])
    if "refused" in result:
        return "refused"
    return "read" if result.get("attributes", 1) else "empty without an exception"


def damaged_copies(data: bytes, count: int, rng: np.random.Generator) -> Iterator[bytes]:
    """Yield copies with ten bytes exchanged, every fourth cut off instead."""
    for number in range(count):
        if number % 4 == 3:
            yield data[: int(rng.integers(0, len(data) + 1))]
            continue
        copy = bytearray(data or b"\0")
        for place in rng.integers(0, len(copy), 10).tolist():
            copy[place] = int(rng.integers(256))
        yield bytes(copy)


def write_large(path: Path) -> dict[str, Any]:
    """Write 24 megapixels: R, G, B, A in half with Z in float, and a part of six channels in half."""
    height, width = 4000, 6000
    specs = []
    for index, names in enumerate(("RGBAZ", "abcdef")):
        spec = oiio.ImageSpec(width, height, len(names), "half")
        spec.channelnames = tuple(names)
        if "Z" in names:
            spec.channelformats = tuple(oiio.TypeFloat if name == "Z" else oiio.TypeHalf for name in names)
        spec.attribute("oiio:subimagename", f"part{index}")
        spec.attribute("compression", "zip")
        specs.append(spec)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), tuple(specs)), output.geterror()
    slope = np.add.outer(np.linspace(0, 1, height), np.linspace(0, 1, width)).astype(np.float32)[..., None]
    for index, spec in enumerate(specs):
        assert not index or output.open(str(path), spec, "AppendSubimage"), output.geterror()
        values = np.random.default_rng(index).random((256, width, spec.nchannels), np.float32)
        for top in range(0, height, 256):
            bottom = min(top + 256, height)
            band = 0.01 * values[: bottom - top] + slope[top:bottom]
            assert output.write_scanlines(top, bottom, 0, band), output.geterror()
    assert output.close(), output.geterror()
    return {}


def write_deep(path: Path) -> dict[str, Any]:
    """Write a megapixel with 0 to 3 samples of A, B, G, R and Z in float per pixel."""
    height, width, names = 1000, 1000, ("R", "G", "B", "A", "Z")
    spec = oiio.ImageSpec(width, height, len(names), "float")
    spec.channelnames, spec.deep = names, True
    spec.attribute("compression", "zips")
    rng = np.random.default_rng(0)
    data = oiio.DeepData()
    data.init(spec)
    for pixel, count in enumerate(rng.integers(0, 4, height * width).tolist()):
        data.set_samples(pixel, count)
        for sample in range(count):
            for channel in range(len(names)):
                data.set_deep_value(pixel, channel, sample, 0.25 * (sample + 1))
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_deep_scanlines(0, height, 0, data), output.geterror()
    assert output.close(), output.geterror()
    return {}


def large_ours(path: Path) -> dict[str, Any]:
    """Replace R of the first part."""
    with ImageFile(path) as file:
        values = file.read(file.parts[0], ["R"])[..., 0]
        splice_ours(path, path.with_name("spliced.exr"), file.parts[0], "R", values)
    return {}


def large_theirs(path: Path) -> dict[str, Any]:
    """Replace R of the first part."""
    with ImageFile(path) as file:
        values = file.read(file.parts[0], ["R"])[..., 0]
        splice_theirs(path, path.with_name("spliced.exr"), file.parts[0], "R", values)
    return {}


def cost(result: dict[str, Any]) -> str:
    """Return processor time and peak memory as text."""
    seconds, peak = result.get("seconds", np.nan), result.get("peak", np.nan)
    return f", {seconds:.2f} s of processor, peak {peak:.0f} MB"


def print_large() -> None:
    """Print processor time and peak memory for large files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "large.exr")
        run(write_large, path)  # a forked process cannot encode after its parent has
        for name, function in {"ours": large_ours, "OpenEXR": large_theirs}.items():
            result = run(function, path)
            print(f"24 megapixels spliced by {name:8s} {outcome(result)}{cost(result)}")
        path = Path(folder, "deep.exr")
        write_deep(path)
        for name, function in {"ours": read_ours, "OpenEXR": read_theirs}.items():
            result = run(function, path)
            print(f"deep megapixel read by {name:8s} {outcome(result)}{cost(result)}")


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--damaged", type=int, default=3, help="damaged copies of each file")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    unique = {}
    for folder in options.folders:
        for path in sorted(folder.rglob("*.exr")) if folder.is_dir() else [folder]:
            unique.setdefault(hashlib.sha256(path.read_bytes()).hexdigest(), path)
    files = list(unique.values())
    print(f"{len(files)} different files")
    readers = {"ours": read_ours, "OpenEXR": read_theirs}
    splicers = {"ours": splice_ours, "OpenEXR": splice_theirs}
    outcomes: dict[str, Counter[str]] = {name: Counter() for name in readers}
    peaks = dict.fromkeys(readers, (0.0, ""))
    disagree = 0
    for path in files:
        results = {name: run(reader, path) for name, reader in readers.items()}
        for name, result in results.items():
            outcomes[name][outcome(result)] += 1
            peaks[name] = max(peaks[name], (result.get("peak", 0.0), path.name))
        if len({outcome(result) for result in results.values()}) > 1:
            if options.verbose:
                print(path, results)
        elif "deep" in results["ours"]:
            disagree += results["ours"]["deep"] != results["OpenEXR"]["deep"]
    for name in readers:
        print(f"read    {name:8s} {dict(outcomes[name])}, peak {peaks[name][0]:.0f} MB at {peaks[name][1]}")
    print(f"files with other counts of deep samples: {disagree}")
    for name, splice in splicers.items():
        lost: Counter[str] = Counter()
        for path in files:
            result = run(spliced, path, splice)
            words = result["lost"] if "lost" in result else [outcome(result)]
            if "skipped" not in result:
                lost.update(words or ["kept"])
            if options.verbose and words and "skipped" not in result:
                print(name, path, result)
        print(f"splice  {name:8s} {dict(lost)}")
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        counts: dict[str, Counter[str]] = {name: Counter() for name in readers}
        for path in files:
            for data in damaged_copies(path.read_bytes(), options.damaged, rng):
                copy = Path(folder, "copy.exr")
                copy.write_bytes(data)
                for name, reader in readers.items():
                    counts[name][outcome(run(reader, copy))] += 1
    for name in readers:
        print(f"damaged {name:8s} {dict(counts[name])}")
    print_large()


if __name__ == "__main__":
    main()
