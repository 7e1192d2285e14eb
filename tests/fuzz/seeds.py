"""Small intact files of every kind that the program reads, written on demand."""

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.commands import ZMX

__all__ = ["REQUESTS", "write_seeds"]

REQUESTS = (
    {"camera": {"blur": 12}, "focus": {"value": 0.5}, "depth": {"repair": "off"}},
    {"blur": 3, "focus": 0.2, "cats-eye": 0.5, "aperture": {"blades": 6, "curvature": 0.2}},
    {"camera": {"f_number": 2, "focal_length": 50, "sensor_width": 36}, "focus": {"distance": 2}},
)
"""Settings of requests to the service."""

CODEV = """RDM;LEN "Singlet"
EPD 10
DIM M
WL 587.6
YAN 0 5
SO 0 1e10
S 50 4 NBK7_SCHOTT
STO
S -50 45
SI 0 0
GO
"""
TABLE = "R,d,n,V,D\n50,4,1.5168,64.17,12\n-50,45,1,0,12\n"
AGF = """CC fuzz
NM N-BK7 2 517642.251 1.5168 64.17 0 1
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653
LD 0.3 2.5
"""
PULL = "frame,blur,focus\n1,2,0.4\n2,3,0.5\n"
SCENE = """[camera]
width = 8
height = 6
focal_length = 50.0
f_number = 4.0
sensor_width = 36.0
focus_distance = 2000.0

[[spheres]]
center = [0.0, 0.0, 2000.0]
radius = 200.0
"""


def write_seeds(folder: Path) -> list[Path]:
    """Write the seeds into an empty folder; kinds whose library is absent are left out."""
    folder.mkdir(parents=True, exist_ok=True)
    for write in (
        _pictures,
        _unusual_pictures,
        _photos,
        _phone_formats,
        _scans,
        _arrays,
        _texts,
        _archives,
        _videos,
        _networks,
    ):
        try:
            write(folder)
        except ImportError:
            continue
    return sorted(path for path in folder.iterdir() if path.is_file())


def _pictures(folder: Path) -> None:
    from tests.unit.io.fuzz.fuzz_readers import valid_files

    valid_files(folder)


def _unusual_pictures(folder: Path) -> None:
    from tests.unit.io.fuzz.unusual_files import MAKERS

    rng = np.random.default_rng(0)
    for number, make in enumerate((*MAKERS, *MAKERS)):
        path = make(folder, rng)
        path.rename(folder / f"unusual{number}{path.suffix}")


def _photos(folder: Path) -> None:
    from tests.unit.io.depth import phone_files

    stored = np.linspace(0, 255, 48 * 64).reshape(48, 64).astype(np.uint8)
    for number, photo in enumerate((phone_files.gdepth_photo, phone_files.extended_gdepth_photo)):
        result: Any = photo(stored, near=1, far=5)
        data = result.read_bytes() if isinstance(result, Path) else bytes(result)
        (folder / f"phone{number}.jpg").write_bytes(data)


def _phone_formats(folder: Path) -> None:
    """Write HEIC and AVIF files: of 8 and 10 bits, grey, with alpha, turned, and of odd sizes."""
    import pillow_heif
    from PIL import Image

    rng = np.random.default_rng(3)
    colours = rng.integers(0, 255, (20, 24, 4), np.uint8)
    modes = {"rgb": (colours[..., :3], "RGB"), "alpha": (colours, "RGBA"), "grey": (colours[..., 0], "L")}
    for name, (values, mode) in modes.items():
        heif = pillow_heif.from_bytes(mode, (24, 20), np.ascontiguousarray(values).tobytes())
        heif.save(folder / f"{name}.heic", quality=80)
        Image.fromarray(values).save(folder / f"{name}.avif", quality=80)
    deep = rng.integers(0, 2**16, (19, 23, 3), np.uint16)
    heif = pillow_heif.from_bytes("RGB;16", (23, 19), deep.tobytes())
    heif.save(folder / "deep.heic", quality=90)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(colours[..., :3]).save(folder / "turned.avif", exif=exif.tobytes())


def _scans(folder: Path) -> None:
    """Write film scans (DPX) of several depths."""
    import OpenImageIO as oiio  # noqa: N813

    rng = np.random.default_rng(2)
    for bits, transfer in ((8, "Linear"), (10, "Printing density"), (12, "Logarithmic"), (16, "ITU-R 709-4")):
        spec = oiio.ImageSpec(24, 20, 3, "uint8" if bits == 8 else "uint16")
        spec.attribute("oiio:BitsPerSample", bits)
        spec.attribute("dpx:Transfer", transfer)
        output = oiio.ImageOutput.create("scan.dpx")
        assert output is not None, oiio.geterror()
        output.open(str(folder / f"scan{bits}.dpx"), spec)
        output.write_image(rng.random((20, 24, 3), np.float32))
        output.close()


def _arrays(folder: Path) -> None:
    """Write maps as NumPy files."""
    ramp = np.linspace(500, 3000, 20 * 24).reshape(20, 24)
    np.save(folder / "map.npy", ramp.astype(np.float32))
    np.save(folder / "millimetres.npy", ramp.astype(np.uint16))
    np.savez(folder / "map.npz", depth=ramp, confidence=np.ones_like(ramp))


def _texts(folder: Path) -> None:
    from bokehnet.lenses.catalog import catalog_names, find_prescription
    from bokehnet.lenses.prescription_toml import prescription_toml

    for name in catalog_names()[:3]:
        (folder / f"lens_{name}.toml").write_text(prescription_toml(find_prescription(name)))
    for name, text in {
        "zemax.zmx": ZMX,
        "codev.seq": CODEV,
        "table.csv": TABLE,
        "glass.agf": AGF,
        "pull.csv": PULL,
        "gains.txt": "1, 1, 0, 0, 3, 1, 1",
        "scene.toml": SCENE,
        "settings.toml": "[camera]\nblur = 20.0\n\n[aperture]\nblades = 6\ncats_eye = 0.5\n",
        "look.toml": 'description = "A look"\n\ncats-eye = 0.4\nblades = 5\n',
        "aberrations.csv": "wavelength,spherical,coma\n450,0.1,0.2\n650,0.3,0.1\n",
    }.items():
        (folder / name).write_text(text)


def _archives(folder: Path) -> None:
    with zipfile.ZipFile(folder / "session.bokeh", "w", zipfile.ZIP_STORED) as archive:
        table = {"format": 1, "picture": "photo.png", "settings": REQUESTS[0], "strokes": []}
        archive.writestr("session.json", json.dumps(table))
        archive.write(folder / "plain.png", "photo.png")
    from bokehnet.lenses.lookup.lens_archive import write_archive
    from bokehnet.lenses.prescription_file import read_prescription

    lens = read_prescription(sorted(folder.glob("lens_*.toml"))[0])
    numbers = {"sensor": 50.0, "sensor_radius": 20.0, "pupil_radius": 10.0}
    coefficients = np.zeros((5, 15))
    arrays = {"degree": 2, "dispersive": True, "coefficients": coefficients, **numbers}
    write_archive(folder / "transfer.npz", "lens ray transfer function 1", lens, **arrays)


def _videos(folder: Path) -> None:
    import av

    for name, codec, pixels in (
        ("a.mp4", "mpeg4", "yuv420p"),
        ("b.mkv", "ffv1", "yuv420p"),
        ("c.mov", "mpeg4", "yuv420p"),
    ):
        with av.open(str(folder / name), "w") as container:
            stream = container.add_stream(codec, rate=25)
            assert isinstance(stream, av.VideoStream)
            stream.width, stream.height, stream.pix_fmt = 32, 24, pixels
            for number in range(3):
                values = np.full((24, 32, 3), 40 * number, np.uint8)
                frame = av.VideoFrame.from_ndarray(values, "rgb24")
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))


def _networks(folder: Path) -> None:
    import onnx
    from onnx import TensorProto, helper

    picture = helper.make_tensor_value_info("image", TensorProto.FLOAT, (1, 3, "h", "w"))
    depth = helper.make_tensor_value_info("depth", TensorProto.FLOAT, (1, 1, "h", "w"))
    axes = helper.make_tensor("axes", TensorProto.INT64, (1,), [1])
    node = helper.make_node("ReduceMean", ["image", "axes"], ["depth"])
    graph = helper.make_graph([node], "mean", [picture], [depth], [axes])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=8)
    onnx.save(model, str(folder / "mean.onnx"))


def text_requests() -> Iterator[str]:
    """Yield the JSON texts of :data:`REQUESTS`."""
    yield from map(json.dumps, REQUESTS)
