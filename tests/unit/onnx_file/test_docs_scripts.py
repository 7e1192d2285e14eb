"""Scripts of the documentation run as printed."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.onnx_file.renderer import build_model
from tests.unit.onnx_file.running import start

ROOT = Path(__file__).parents[3]

# Runs a script in a process in which bokehnet, torch and onnx cannot be imported.
_WITHOUT_PACKAGE = """
import sys
for name in ("bokehnet", "torch", "onnx"):
    sys.modules[name] = None
exec(compile(open("script.py").read(), "script.py", "exec"))
"""


def python_blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.slow
def test_the_script_of_the_page_runs_without_the_package(tmp_path):
    """Authority: the file's own result in this process."""
    script = python_blocks("docs/use/one_file.md")[0]
    model = build_model(engine="rays")
    (tmp_path / "rays.onnx").write_bytes(model.SerializeToString())
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    picture = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)
    depth = np.full((40, 50), 23_000, np.uint16)  # as maps of depth networks are written
    depth[10:30, 15:35] = 31_000
    Image.fromarray(picture).save(tmp_path / "photo.png")
    Image.fromarray(depth).save(tmp_path / "map.png")
    command = [sys.executable, "-I", "-c", _WITHOUT_PACKAGE]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=300)
    inputs = {
        "image": srgb_to_linear(picture / np.float32(255)),
        "disparity": (depth > 23_000).astype(np.float32),
    }
    numbers = {name: np.array(x, np.float32) for name, x in {"K": 60, "focus": 0.35, "gamma": 1}.items()}
    expected = start(model, threads=1).run(None, inputs | numbers)[0]
    written = np.asarray(Image.open(tmp_path / "bokeh.png"), float)
    assert np.abs(written - 255 * linear_to_srgb(expected.clip(0, 1))).max() < 0.6
