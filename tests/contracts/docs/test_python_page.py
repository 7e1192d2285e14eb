"""The blocks of docs/use/python.md run as printed, in one session. Authority: the page's claim."""

import re

import numpy as np
import pytest

import bokehnet
from bokehnet.io.image import write_image, write_map
from tests.conftest import ROOT

PAGE = ROOT / "docs/use/python.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
EXTRAS = {"PIL", "cv2", "torch"}


@pytest.mark.slow
def test_all_blocks_run_in_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    near = np.zeros((48, 64), np.float32)
    near[12:40, 20:44] = 1
    write_image("photo.jpg", np.random.default_rng(0).random((48, 64, 3), dtype=np.float32))
    write_map("disparity.png", near)
    names: dict = {}
    skipped = set()
    for block in BLOCKS:
        try:
            exec(compile(block, str(PAGE), "exec"), names)
        except ModuleNotFoundError as error:
            if error.name not in EXTRAS:
                raise
            skipped.add(error.name)
    assert len(BLOCKS) - len(skipped) >= 8
    assert {path.name for path in tmp_path.iterdir()} >= {
        "photo_bokeh.jpg",
        "out.png",
        "maps",
        "settings.toml",
    }
    assert bokehnet.read_image("photo_bokeh.jpg").shape == names["image"].shape == (48, 64, 3)
    assert names["room"].depth.kind == "metric"
