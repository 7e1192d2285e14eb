"""The README's Python does what the command above it does. Authority: the file that the command writes."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import bokehnet
from bokehnet.cli.app import run
from bokehnet.io.image import write_image, write_map
from tests.conftest import ROOT
from tests.unit.io.depth.phone_files import encode, gdepth_photo
from tests.unit.io.exr.exr_files import read_channels, write_exr

onnx = pytest.importorskip("onnx", reason="writes networks with onnx, of the extra train")
TensorProto, helper = onnx.TensorProto, onnx.helper

pytestmark = pytest.mark.slow

PAGES = ("README.md", "docs/use/examples.md")
TEXT = "\n".join((ROOT / page).read_text(encoding="utf-8") for page in PAGES)
PAIRS = list(dict.fromkeys(re.findall(r"```sh\n(# [^`]*?)```\n\n```python\n(.*?)```", TEXT, flags=re.DOTALL)))
WIDTH, HEIGHT = 112, 72
FOCUS = {"640,410": "92,56", "(640, 410)": "(92, 56)"}  # pixels of the documentation in this picture
SMALL = 8  # pixels of the picture to one of the maps
SETTINGS = '[input]\ndisparity = "disparity.png"\n[camera]\nblur = 60\n[focus]\nvalue = 0.35\n'
SHOT = (
    '[input]\ndepth = "z.####.exr"\n[camera]\nfocal_length = 50\nf_number = 2\nsensor_width = 36\n'
    '[engine]\nname = "scatter"\n'
)


def lines_of(code: str) -> list[str]:
    return [line for line in code.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def commands_of(block: str) -> list[list[str]]:
    lines = [line for line in block.replace("\\\n", " ").splitlines() if not line.startswith("#")]
    return [shlex.split(line)[1:] for line in lines]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The files that the README's commands read, with a step of depth in each."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    near = np.zeros((HEIGHT // SMALL, WIDTH // SMALL), np.float32)
    near[:, 7:] = 1
    near = np.kron(near, np.ones((SMALL, SMALL), np.float32))
    near = np.pad(near, ((0, 0), (0, WIDTH - near.shape[1])), "edge")
    photo = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
    write_image("photo.jpg", photo)
    write_map("disparity.png", near)
    Path("settings.toml").write_text(SETTINGS, encoding="utf-8")
    Path("shot.toml").write_text(SHOT, encoding="utf-8")
    colors = {name: ("half", photo[..., i]) for i, name in enumerate("RGB")}
    write_exr("shot.exr", {"channels": {**colors, "Z": ("float", 4 - 3 * near)}})
    for frame in (1001, 1050, 1100):
        small = {name: (kind, values[:40, 26:86]) for name, (kind, values) in colors.items()}
        write_exr(f"shot.{frame}.exr", {"channels": small})
        write_exr(f"z.{frame}.exr", {"channels": {"Z": ("float", 4 - 3 * near[:40, 26:86])}})
    jpeg = encode((255 * photo).astype(np.uint8), "JPEG", quality=95)
    stored = encode((255 - 200 * near[::4, ::4]).astype(np.uint8), "PNG")
    Path("portrait.jpg").write_bytes(gdepth_photo(stored, jpeg=jpeg, near=0.8, far=4, units="m"))
    write_network("depth_anything_v2.onnx")
    return tmp_path


def write_network(path: str) -> None:
    """A network that takes the mean of the colours for disparity."""
    shapes = ([1, 3, "h", "w"], [1, "h", "w"])
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in zip("xy", shapes, strict=True)]
    axes = helper.make_tensor("axes", TensorProto.INT64, [1], [1])
    node = helper.make_node("ReduceMean", ["x", "axes"], ["y"], keepdims=0)
    graph = helper.make_graph([node], "mean", ends[:1], ends[1:], [axes])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)


def test_there_are_pairs_of_at_most_six_lines():
    assert len(PAIRS) >= 8
    for _, code in PAIRS:
        assert len(lines_of(code)) <= 6, code


@pytest.mark.parametrize(("block", "code"), PAIRS, ids=[block.splitlines()[0][2:40] for block, _ in PAIRS])
def test_python_writes_what_the_command_writes(folder, block, code, monkeypatch):
    # A hundred frames are three here, by the engine scatter.
    block = block.replace("1001-1100", "1001-1100x99,1050").replace("--jobs 2", "--engine scatter")
    code = code.replace("range(1001, 1101)", "(1001, 1050, 1100)")
    for shown, scaled in FOCUS.items():
        block, code = block.replace(shown, scaled), code.replace(shown, scaled)
    before = {path.name for path in folder.iterdir()}
    for words in commands_of(block):
        assert run(words) == 0
    written = {path.name: path.read_bytes() for path in folder.iterdir() if path.name not in before}
    expected = {name: read_channels(name) for name in written if name.endswith(".exr")}
    assert written
    for name in written:
        (folder / name).unlink()
    disparity = bokehnet.io.maps.read_disparity("disparity.png")
    names = {name: getattr(bokehnet, name) for name in bokehnet.__all__} | {"disparity": disparity}
    exec(compile(code, "README.md", "exec"), names)
    assert {path.name for path in folder.iterdir() if path.name not in before} == written.keys()
    for name, content in written.items():
        if name not in expected:
            assert (folder / name).read_bytes() == content, name
            continue
        for channel, (kind, values) in read_channels(name).items():
            assert kind == expected[name][channel][0]
            np.testing.assert_array_equal(values, expected[name][channel][1])
